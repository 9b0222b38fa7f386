"""A training run that is to be done, and the collaborators it needs."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
import torch

from transferkit.budget import KINDS, Budget, Spent
from transferkit.config import TrainConfig, identity, migrated_blueprint
from transferkit.envs import VectorEnv, derive_spec, dims, episode_limit, find_mirror, is_written, make_env, names_module
from transferkit.errors import ConfigError, SettingError, TransferkitError, reason_of
from transferkit.evaluation import ZeroPolicy, evaluate
from transferkit.files import check_folder, damaged_run
from transferkit.policy.blueprints import Sandwiched, plan_of
from transferkit.policy.make import scratch_policy
from transferkit.policy.saved import as_saved, read_policy, state_of
from transferkit.probation import hold_probation
from transferkit.record.experience import joined, load_experience
from transferkit.record.play import Subject, record_evaluation
from transferkit.run import (
    BEST,
    CHECKPOINT,
    LATEST,
    RECORD,
    RESULT,
    UNTRAINED,
    Result,
    RunDirectory,
    Schedule,
    Session,
    check_free,
    check_same,
    is_run,
    read_made_of,
    read_record,
)
from transferkit.streams import Streams
from transferkit.trainers.compilation import check_compiler, is_captured, is_compiled
from transferkit.trainers.make import make_trainer

if TYPE_CHECKING:
    from transferkit.evaluation import Evaluation
    from transferkit.matching import Match
    from transferkit.policy.base import Policy
    from transferkit.policy.core import Core
    from transferkit.record.reader import Transitions
    from transferkit.run import Probation, Report, Scores
    from transferkit.trainers.loop import Trainer

LOGGER = logging.getLogger("transferkit")

LEEWAY = 0.1
"""Share of the way from doing nothing to the core by which episodes of training may be worse: they have noise, it had none."""

Ledger = Sequence[Mapping[str, Any]]
"""Name, steps and hash of each recording that training starts with."""


@dataclass(frozen=True)
class Job:
    """A configuration with the policy and the environment it names; each method makes one collaborator of the run."""

    config: TrainConfig
    policy: Policy
    env: str | Callable[[], gymnasium.Env]
    """In writing, or what makes one."""
    out: Path
    core: Core | None = None
    record_every: int = 0
    resume: bool = False
    """Whether to take up what is in the folder."""
    probation: Probation | None = None
    """What was found of the core."""
    seen: Transitions | None = None
    """What was seen of the target meanwhile, for a run that is yet to start."""
    untrained: Policy | None = None
    """The core as it was wrapped, to fall back on."""

    def make_env(self) -> gymnasium.Env:
        """Make one environment under the contract."""
        return make_env(self.env, **asdict(self.config.env_config))

    def check(self) -> None:
        """Refuse a budget, a device, a folder or a policy that does not fit, before anything is played or written."""
        check_folder(self.out, "out")
        if not self._is_recorded:
            check_free(self.out)
        self._budget()
        _device(self.config.device)
        with closing(self.make_env()) as env:
            self.policy.check_fits(dims(env), self.config.env)

    def on_probation(self) -> Job:
        """Let the core prove itself; a job whose core is refused is one from scratch."""
        pairs = self.config.wrap.probation
        if self.core is None or not pairs:
            return self
        recorded = read_made_of(read_record(self.out)).probation if self._is_recorded else None
        if self._is_under_way:
            return self if recorded is None else self._judged(recorded, None)
        held = hold_probation(self.policy, self.make_env, self._budget(), pairs, self.config.seed, self.config.wrap.least_gain)
        if held is None:
            LOGGER.warning("%s is trusted: a tenth of the budget is too little to play against doing nothing", self.core.id)
            return self
        found, seen = held
        LOGGER.warning("%s is %s: it is %s", self.core.id, "trusted" if found.accepted else "refused", found.reason)
        return self._judged(recorded or found, seen)

    def _judged(self, found: Probation, seen: Transitions | None) -> Job:
        if found.accepted:
            untrained = as_saved(self.policy) if self.config.wrap.fall_back and found.core else None
            return replace(self, probation=found, seen=seen, untrained=untrained)
        scratch = scratch_policy(self.env, self.config.network, seed=self.config.seed)
        return replace(self, probation=found, policy=scratch)

    @property
    def _is_recorded(self) -> bool:
        return self.resume and is_run(self.out)

    @property
    def _is_under_way(self) -> bool:
        return self.resume and ((self.out / CHECKPOINT).exists() or (self.out / RESULT).exists())

    def experience(self) -> tuple[Transitions | None, Ledger]:
        """Load what to start with, and the ledger of its recordings; a run that has a checkpoint needs it no more."""
        config, out = self.config, self.out
        if not config.experience:
            return self.seen, []
        if self._is_under_way:
            return None, [asdict(recording) for recording in read_made_of(read_record(out)).recordings]
        transitions, ledger = load_experience(config.experience, config.mapping, derive_spec(self.env))
        if len(transitions) > config.dyna.buffer_size:
            least = f"at least the {len(transitions)} steps of experience"
            raise SettingError("dyna.buffer_size", value=config.dyna.buffer_size, allowed=least)
        return transitions if self.seen is None else joined((transitions, self.seen)), ledger

    def compiles(self) -> bool:
        """Decide whether the updates are compiled; a run that is taken up goes on as it was."""
        recorded = read_made_of(read_record(self.out)).compiled if self._is_recorded else None

        def limit() -> int | None:
            with closing(self.make_env()) as env:
                return episode_limit(env)

        return is_compiled(self.config, limit, lambda: derive_spec(self.env).time_step, recorded=recorded)

    def open(self, ledger: Ledger, *, compiled: bool) -> tuple[RunDirectory, dict[str, Any] | None]:
        """Start the run's directory, or take it up with its last checkpoint if its record is the same.

        One that is finished goes on if all but its budget is the same, and that is more than it has spent.
        """
        made_of: dict[str, Any] = {"compiled": True} if compiled else {}
        made_of |= {"policy": self.policy.blueprint(), "core_digest": self.core and self.core.digest}
        made_of |= {"recordings": list(ledger)} if ledger else {}
        made_of |= {"probation": asdict(self.probation)} if self.probation else {}
        known = is_written(self.config.env) and not names_module(self.config.env)
        made_of |= {} if known else {"spec": derive_spec(self.env).to_json()}
        if not self._is_recorded:
            return RunDirectory.create(self.out, {**asdict(self.config), **made_of}), None
        recorded = read_record(self.out)
        if "spec" not in recorded:  # an earlier version's
            made_of.pop("spec", None)
        before = identity(TrainConfig.from_json(recorded)) | {name: recorded[name] for name in made_of if name in recorded}
        with damaged_run(self.out / RECORD):
            before["policy"] = _complete(migrated_blueprint(read_made_of(recorded).policy))
        made_of = {name: _known(value, before.get(name, value)) for name, value in made_of.items()}
        now = identity(self.config) | made_of
        if now["core_digest"] and now["core_digest"] == before.get("core_digest"):  # whatever its folder is called today
            before["core"] = now["core"]
        check_same(self.out, _but_budget(before), _but_budget(now))
        return RunDirectory.resume(self.out, self._budget())

    def trainer(self, prior: Transitions | None, *, compiled: bool) -> Trainer:
        """Make the trainer around the policy."""
        if compiled and not is_captured(self.config):
            check_compiler()
        streams, device = Streams(self.config.seed), _device(self.config.device)
        of_env = partial(derive_spec, self.env), partial(find_mirror, self.env)
        arrays = prior.batch() if prior else None
        return make_trainer(self.policy, self.config, *of_env, streams, device, arrays, compiles=compiled)

    def envs(self, trainer: Trainer) -> VectorEnv:
        """Make as many environments as the trainer steps."""
        made = [self.make_env() for _ in range(trainer.num_envs)]
        seed_of = partial(Streams(self.config.seed).integer, "environment")
        return VectorEnv(made, seed_of, overrun_steps=trainer.overrun_steps, hold=trainer.hold)

    def session(self, directory: RunDirectory, trainer: Trainer, report: Report | None) -> Session:
        """Make the session that counts the run's experience."""
        config = self.config
        schedule = Schedule(config.eval_every, config.stop_at, config.checkpoint_seconds)
        probation = self.probation
        charged = probation and Spent(probation.episodes, probation.steps, probation.seconds)

        def keep_best(session: Session) -> None:
            directory.save_policy(self.trained(trainer, session), BEST)

        callbacks: dict[str, Any] = {"evaluate": self.evaluate, "keep_best": keep_best, "report": report}
        keeps_peak = config.algo == "dyna-ddpg" and config.dyna.keep_peak
        accounts = {
            "charged": charged,
            "to_beat": self._to_beat,
            "leeway": self._leeway,
            "falls_back": self.untrained is not None,
            "keeps_peak": keeps_peak,
        }
        return Session(directory, self._budget(), trainer.num_envs, **callbacks, schedule=schedule, **accounts)

    def with_untrained(self, directory: RunDirectory, *, begun: bool) -> Job:
        """Keep the core as it was wrapped beside the run, or take it from there: the policy may have been trained since."""
        if self.untrained is None:
            return self
        path = directory.path / UNTRAINED
        if begun and path.exists():
            return replace(self, untrained=read_policy(path))
        directory.save_policy(state_of(self.untrained, {}), UNTRAINED)
        return self

    def better(self, session: Session) -> Policy:
        """The policy to evaluate and to save: what was learnt, or the untrained core as long as that is behind it."""
        return self.untrained if self.untrained is not None and session.plays_core else self.policy

    def evaluate(self, session: Session) -> Evaluation:
        """Evaluate the policy as it would be loaded, and record an episode if one is due."""
        policy, config = as_saved(self.better(session)), self.config
        if self.record_every and session.evaluations % self.record_every == 0:
            steps = session.spent.steps
            about = {"run": str(self.out), "core": config.core, "training_seed": config.seed, "steps": steps}
            record_evaluation(Subject(policy, self.env, **asdict(config.env_config), about=about), self.out, steps)
        return evaluate(policy, self.make_env, episodes=config.eval_episodes)

    def trained(self, trainer: Trainer, session: Session) -> dict[str, Any]:
        """Collect the better policy, and what was trained beside it, to be saved; nothing is beside the untrained core."""
        better = self.better(session)
        return state_of(better, trainer.trained() if better is self.policy else {})

    def result(self, session: Session, scores: Scores, ledger: Ledger) -> Result:
        """Sum up the finished run."""
        config, spent = self.config, session.spent
        named = {name: getattr(config, name) for name in ("algo", "preset", "core", "env", "seed")}
        return Result(
            **named,
            core_digest=self.core and self.core.digest,
            member=config.member if self.core else None,
            episodes=spent.episodes,
            steps=spent.steps,
            seconds=round(spent.seconds, 3),
            eval_return_mean=scores["return_mean"],
            eval_return_std=scores["return_std"],
            eval_return_low=scores["return_low"],
            eval_return_high=scores["return_high"],
            eval_episodes=int(scores["n"]),
            run_dir=str(self.out),
            prior_steps=sum(entry["steps"] for entry in ledger),
            best=session.best,
            evaluation_steps=session.evaluation_steps,
            fell_back=session.plays_core,
            probation=self.probation,
            earlier=session.directory.earlier,
        )

    def warn(self, session: Session) -> None:
        """Say if training has come to less than doing nothing, or to less than the core could at once."""
        latest = session.latest_return
        if latest is None:
            return
        zero = self._return_of_nothing()
        if zero is not None and latest < zero:
            worse, remedy = f"doing nothing ({zero:.4g})", "a larger budget or another preset"
        elif session.is_behind:
            worse, remedy = f"the untrained core ({self._to_beat:.4g})", "a larger budget"
        else:
            return
        if session.plays_core:
            worse += "; the run keeps the untrained core"
        elif session.keeps_peak:
            worse += f"; the run keeps the policy of its best ones ({session.peak:.4g})"
        LOGGER.warning("the last training episodes (mean return %.4g) are worse than %s: try %s", latest, worse, remedy)

    def _return_of_nothing(self) -> float | None:
        """The mean return of zero action, played now, off the budget, if no probation did; None if it cannot be played."""
        if self.probation and self.probation.zero:
            return float(np.mean(self.probation.zero))
        try:
            return evaluate(ZeroPolicy(self.policy.act_dim), self.make_env, episodes=LATEST).mean
        except TransferkitError:  # the environment stands no zero action
            return None

    @property
    def _to_beat(self) -> float | None:
        found = self.probation
        return float(np.mean(found.core)) if found and found.accepted and found.core else None

    @property
    def _leeway(self) -> float:
        """What noise may cost of the return to beat."""
        found = self.probation
        return LEEWAY * float(np.mean(found.core) - np.mean(found.zero)) if found and found.core and found.zero else 0.0

    def _budget(self) -> Budget:
        return Budget(self.config.episodes, self.config.steps, self.config.seconds)


def _but_budget(facts: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in facts.items() if name not in KINDS}


def match_of(run: Path) -> Match | None:
    """The match with which the policy of a run in progress began; None if there is no run, or none was used.

    Raises:
        RunDirectoryError: its record is damaged.
    """
    if not is_run(run):
        return None
    with damaged_run(run / RECORD):
        plan = plan_of(read_made_of(read_record(run)).policy)
        return plan.matched() if isinstance(plan, Sandwiched) and plan.adapter != "pad" else None


def _complete(blueprint: Mapping[str, Any]) -> dict[str, Any]:
    """A recorded blueprint with the match that earlier versions did not keep."""
    if blueprint.get("kind") != "sandwich" or "match" in blueprint:
        return dict(blueprint)
    plan = plan_of(blueprint)
    match = plan.matched() if isinstance(plan, Sandwiched) else None
    return {**blueprint, "match": match and json.loads(json.dumps(asdict(match)))}


def _known(value: object, recorded: object) -> object:
    """What an earlier version would have recorded of a value: specs have fields that it did not know."""
    if isinstance(value, Mapping) and isinstance(recorded, Mapping):
        return {name: _known(inner, recorded[name]) for name, inner in value.items() if name in recorded}
    if isinstance(value, list | tuple) and isinstance(recorded, list) and len(value) == len(recorded):
        return [_known(inner, own) for inner, own in zip(value, recorded, strict=True)]
    return value


def _device(name: str) -> torch.device:
    try:
        device = torch.device(name)
        torch.ones(1, device=device).item()  # which devices without numbers cannot
        torch.Generator(device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise ConfigError(f"device '{name}' cannot be used ({reason_of(error)})", remedy="use {device=cpu}") from None
    if device.type == "cpu" and name != "cpu":
        raise ConfigError(f"device '{name}': a CPU has no number", remedy="use {device=cpu}")
    return device
