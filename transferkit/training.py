"""The composition root: core, target and configuration to a policy, a trainer, an evaluation and a run directory."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import torch

from transferkit.budget import Budget
from transferkit.config import TrainConfig, identity, migrated_blueprint, with_settings
from transferkit.envs import VectorEnv, derive_spec, dims, make_env
from transferkit.errors import ConfigError, SettingError
from transferkit.evaluation import evaluate
from transferkit.nn import one_thread
from transferkit.policy.make import new_policy
from transferkit.policy.saved import as_saved, state_of
from transferkit.record.experience import load_experience
from transferkit.record.play import record_evaluation
from transferkit.run import CHECKPOINT, RECORD, RESULT, Result, RunDirectory, Schedule, Session, check_same, read_record
from transferkit.streams import Streams
from transferkit.trainers.loop import migrated_checkpoint, run_loop
from transferkit.trainers.make import make_trainer
from transferkit.zoo.artifact import load_core

if TYPE_CHECKING:
    from transferkit.config import Algorithm
    from transferkit.policy.base import Policy
    from transferkit.policy.core import Core
    from transferkit.record.reader import Transitions
    from transferkit.run import Report, Scores
    from transferkit.trainers.loop import Trainer

RUNS = Path("runs")
"""Folder of run directories that are not named."""

MakeEnv = Callable[[], gymnasium.Env]

Ledger = Sequence[Mapping[str, Any]]
"""Name, steps and hash of each recording that training starts with."""


def run_training(
    config: TrainConfig,
    *,
    policy: Policy | None = None,
    out: Path | None = None,
    resume: bool = False,
    report: Report | None = None,
    record_every: int = 0,
) -> Result:
    """Do what a configuration says: build the policy, train it, evaluate it, and keep everything in `out`.

    Args:
        config: the whole run.
        policy: use this untrained policy instead of the configured one, for a control.
        out: the run directory; by default `runs/` with a name made of the configuration.
        resume: go on where the directory stopped, start if there is none, return the result if it is finished.
        report: called after every update.
        record_every: record an episode of every so many evaluations as `recordings/step_<N>.mcap` in the run directory.

    Raises:
        TransferkitError: any of its kinds; see `transferkit.errors`.
    """
    with one_thread():  # the fastest for small networks, and the only number that always gives the same bits
        core = None if config.core is None else load_core(config.core)
        make = partial(make_env, config.env, clip_actions=config.env_config.clip_actions)
        job = _Job(config, policy or new_policy(config, core), make, out or default_directory(config), core, record_every)
        return _run(job, resume=resume, report=report)


def train(
    policy: Policy,
    env: str | MakeEnv,
    budget: Budget,
    *,
    algo: Algorithm = "ppo",
    preset: str = "default",
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
    out: str | Path | None = None,
    resume: bool = False,
    device: str = "cpu",
    eval_episodes: int = 20,
    eval_every: int = 0,
    stop_at: float | None = None,
    report: Report | None = None,
) -> Result:
    """Train a policy in place, evaluate it, and keep everything in a run directory.

    Args:
        policy: from `wrap` or `scratch_policy`.
        env: an id, or a function that makes one environment.
        budget: episodes, steps or seconds; the first one reached ends training.
        algo: the trainer.
        preset: which trainer settings to use: `default`, `paper`, or a version of them, such as `default-v1`.
        settings: single settings over the preset, by dotted name, such as `{"ppo.learning_rate": 1e-3}`.
        seed: of every random stream of training.
        out: the run directory; by default under `runs/`.
        resume: go on where the directory stopped.
        device: of the networks.
        eval_episodes: episodes of an evaluation.
        eval_every: environment steps between evaluations during training; 0 for only one at the end.
        stop_at: mean return of an evaluation, after the first one, that ends training before the budget does.
        report: called after every update.

    Raises:
        TransferkitError: any of its kinds; see `transferkit.errors`.
    """
    name = env if isinstance(env, str) else getattr(env, "__name__", type(env).__name__)
    config = TrainConfig(
        name,
        algo=algo,
        preset=preset,
        seed=seed,
        device=device,
        **asdict(budget),
        eval_episodes=eval_episodes,
        eval_every=eval_every,
        stop_at=stop_at,
    )
    config = with_settings(config, settings or {})
    with one_thread():
        job = _Job(config, policy, partial(_make, env, config), default_directory(config) if out is None else Path(out))
        return _run(job, resume=resume, report=report)


def default_directory(config: TrainConfig) -> Path:
    """Name a run directory: `runs/<env>_<core or scratch>_<algo>_<preset>_seed<k>`, the preset without its version."""
    core = "scratch" if config.core is None else f"{Path(config.core).name}.{config.member}"
    env, preset = config.env.replace("/", "-"), config.preset.rpartition("-v")[0]
    return RUNS / f"{env}_{core}_{config.algo}_{preset}_seed{config.seed}"


@dataclass(frozen=True)
class _Job:
    """A run that is to be done."""

    config: TrainConfig
    policy: Policy
    make_env: MakeEnv
    out: Path
    core: Core | None = None
    record_every: int = 0

    def evaluate(self, session: Session) -> Scores:
        """Evaluate the policy as it would be loaded, and record an episode if one is due."""
        policy, config = as_saved(self.policy), self.config
        if self.record_every and session.evaluations % self.record_every == 0:
            about = {"run": str(self.out), "core": config.core, "training_seed": config.seed}
            clip = config.env_config.clip_actions
            record_evaluation(policy, config.env, about, self.out, session.spent.steps, clip_actions=clip)
        return evaluate(policy, self.make_env, episodes=config.eval_episodes).scores()

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
        )


def _run(job: _Job, *, resume: bool, report: Report | None) -> Result:
    config, device, env = job.config, _device(job.config.device), job.make_env()
    budget = Budget(config.episodes, config.steps, config.seconds)
    _check_dims(job.policy, env, config.env)
    prior, ledger = _experience(config, job.out, resume=resume)
    directory, checkpoint = _open(job, ledger, resume=resume)
    with directory:
        if directory.result is not None:
            return Result(**directory.result)
        streams = Streams(config.seed)
        trainer = make_trainer(job.policy, config, job.make_env, streams, device, prior.batch() if prior else None)
        others = [job.make_env() for _ in range(trainer.num_envs - 1)]
        seed_of = partial(streams.integer, "environment")
        envs = VectorEnv([env, *others], seed_of, overrun_steps=trainer.overrun_steps)
        schedule = Schedule(config.eval_every, config.stop_at, config.checkpoint_seconds)
        session = Session(directory, budget, envs.num_envs, evaluate=job.evaluate, schedule=schedule, report=report)
        scores = _train_and_evaluate(trainer, envs, session, checkpoint)
        directory.save_policy(state_of(job.policy, trainer.trained()))
        result = job.result(session, scores, ledger)
        directory.finish(asdict(result))
        return result


def _train_and_evaluate(trainer: Trainer, envs: VectorEnv, session: Session, checkpoint: Mapping[str, Any] | None) -> Scores:
    if checkpoint is not None:
        checkpoint = migrated_checkpoint(checkpoint)
        session.restore(checkpoint["session"])
    with session.running(), closing(envs):
        if checkpoint is None and session.schedule.eval_every:
            session.evaluate()  # before any training: the jumpstart
        run_loop(trainer, envs, session, checkpoint)
        return session.evaluate()


def _open(job: _Job, ledger: Ledger, *, resume: bool) -> tuple[RunDirectory, dict[str, Any] | None]:
    """Start the run's directory, or take it up with its last checkpoint if its record is the same."""
    made_of = {"policy": job.policy.blueprint(), "core_digest": job.core and job.core.digest}
    made_of |= {"recordings": list(ledger)} if ledger else {}
    if not (resume and (job.out / RECORD).exists()):
        return RunDirectory.create(job.out, {**asdict(job.config), **made_of}), None
    recorded = read_record(job.out)
    before = identity(TrainConfig.from_json(recorded)) | {name: recorded[name] for name in made_of if name in recorded}
    before["policy"] = migrated_blueprint(recorded["policy"])
    check_same(job.out, before, identity(job.config) | made_of)
    return RunDirectory.resume(job.out)


def _experience(config: TrainConfig, out: Path, *, resume: bool) -> tuple[Transitions | None, Ledger]:
    """Load what to start with, and where it is from; a run that has a checkpoint needs its recordings no more."""
    if not config.experience:
        return None, []
    if resume and ((out / CHECKPOINT).exists() or (out / RESULT).exists()):
        return None, read_record(out).get("recordings", [])
    transitions, ledger = load_experience(config.experience, config.mapping, derive_spec(config.env))
    if len(transitions) > config.dyna.buffer_size:
        raise SettingError(
            "dyna.buffer_size",
            value=config.dyna.buffer_size,
            allowed=f"at least the {len(transitions)} steps of experience",
        )
    return transitions, ledger


def _make(env: str | MakeEnv, config: TrainConfig) -> gymnasium.Env:
    return make_env(env if isinstance(env, str) else env(), clip_actions=config.env_config.clip_actions)


def _check_dims(policy: Policy, env: gymnasium.Env, name: str) -> None:
    needed = dims(env)
    if (policy.obs_dim, policy.act_dim) != needed:
        raise ConfigError(
            f"the policy takes {policy.obs_dim} observations and {policy.act_dim} actions, environment {name} has "
            f"{needed[0]} and {needed[1]}",
            remedy=f"build it with wrap(core, '{name}')",
        )


def _device(name: str) -> torch.device:
    try:
        device = torch.device(name)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise ConfigError(f"device '{name}' cannot be used ({reason})", remedy="use {device=cpu}") from None
    return device
