"""The composition root: core, target and configuration to a policy, a trainer, an evaluation and a run directory."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from transferkit.budget import Budget
from transferkit.config import TrainConfig, check_read, preset_family, with_settings
from transferkit.config.checks import check_kind
from transferkit.envs import copies_of, derive_spec, recorded, rules_of
from transferkit.errors import ConfigError
from transferkit.job import Job, match_of
from transferkit.matching import match_for
from transferkit.nn import one_thread
from transferkit.policy.base import Policy
from transferkit.policy.make import new_policy
from transferkit.trainers.loop import train_and_evaluate
from transferkit.zoo.artifact import load_core

if TYPE_CHECKING:
    from transferkit.config import Algorithm
    from transferkit.envs import EnvLike
    from transferkit.matching import Match
    from transferkit.policy.core import Core
    from transferkit.run import Report, Result

LOGGER = logging.getLogger("transferkit")

RUNS = Path("runs")
"""Folder of run directories that are not named."""

LONGEST = 200
"""Characters of such a folder's name; file systems take 255 bytes."""


def run_training(
    config: TrainConfig,
    *,
    policy: Policy | None = None,
    out: str | Path | None = None,
    resume: bool = False,
    report: Report | None = None,
    record_every: int = 0,
) -> Result:
    """Do what a configuration says: build the policy, train it, evaluate it, and keep everything in `out`.

    Args:
        config: the whole run.
        policy: use this untrained policy instead of the configured one, for a control.
        out: the run directory; by default `runs/` with a name made of the configuration.
        resume: go on where the directory stopped, start if there is none, return the result if it is finished. A finished run
            goes on if all but the budget is the same, and that is more than it has spent.
        report: called after every update.
        record_every: record an episode of every so many evaluations as `recordings/step_<N>.mcap` in the run directory.

    Raises:
        TransferkitError: any of its kinds; see `transferkit.errors`.
    """
    check_kind("config", config, TrainConfig, "make one, such as TrainConfig('Hopper-v5', steps=10_000)")
    with one_thread():  # the fastest for small networks, and the only number that always gives the same bits
        core = None if config.core is None else load_core(config.core, env=config.env)
        out = default_directory(config) if out is None else Path(out)
        began = match_of(out) if resume else None
        if core is not None and began is not None:
            _check_unedited(config, core, began)
        policy = policy or new_policy(config, core, began)
        job = Job(config, policy, config.env, out, core, record_every, resume)
        return _run(job, report)


def train(
    policy: Policy,
    env: EnvLike,
    budget: Budget,
    *,
    algo: Algorithm = "ppo",
    preset: str = "default",
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
    out: str | Path | None = None,
    resume: bool = False,
    device: str = "cpu",
    compile: Literal["auto", "on", "off"] = "auto",  # noqa: A002 - the setting's name
    eval_episodes: int = 20,
    eval_every: int = 0,
    stop_at: float | None = None,
    report: Report | None = None,
) -> Result:
    """Train a policy in place, evaluate it, and keep everything in a run directory.

    What is evaluated and kept, for `load_policy`, is another policy if the core of this one was refused (`result.probation`) or
    is still ahead of what was learnt (`result.fell_back`).

    Args:
        policy: from `wrap` or `scratch_policy`.
        env: in any form that `make_env` takes; of one that is made copies are trained in.
        budget: episodes, steps or seconds; the first one reached ends training.
        algo: the trainer.
        preset: which trainer settings to use: `default`, `paper`, or a version of them, such as `default-v1`.
        settings: single settings over the preset, by dotted name, such as `{"ppo.learning_rate": 1e-3}`.
        seed: of every random stream of training.
        out: the run directory; by default under `runs/`.
        resume: go on where the directory stopped, or, if that is finished, with a budget that is larger than what it has spent.
        device: of the networks.
        compile: whether a C++ compiler makes the updates faster; `auto` if the budget pays for it.
        eval_episodes: episodes of an evaluation.
        eval_every: environment steps between evaluations during training; 0 for only one at the end.
        stop_at: mean return of an evaluation, after the first one, that ends training before the budget does.
        report: called after every update.

    Raises:
        TransferkitError: any of its kinds; see `transferkit.errors`.
    """
    check_kind("policy", policy, Policy, "make one with wrap(core, env) or scratch_policy(env)")
    check_kind("budget", budget, Budget, "give one, such as Budget(episodes=200)")
    check_kind("settings", {} if settings is None else settings, Mapping, "give them by name, such as {'ppo.gamma': 0.98}")
    check_kind("out", "" if out is None else out, (str, Path), "give a folder, such as 'runs/mine'")
    core, wrapping = _core_of(policy)
    config = TrainConfig(
        recorded(env),
        **wrapping,
        **asdict(budget),
        **{"algo": algo, "preset": preset, "seed": seed, "device": device, "compile": compile},
        **{"eval_episodes": eval_episodes, "eval_every": eval_every, "stop_at": stop_at},
    )
    given = {f"env_config.{name}": value for name, value in rules_of(env).items()} | dict(settings or {})
    config = with_settings(config, given)
    check_read(config, given, ready=True)
    with one_thread():
        out = default_directory(config) if out is None else Path(out)
        return _told(_run(Job(config, policy, copies_of(env), out, core, resume=resume), report), out)


def _check_unedited(config: TrainConfig, core: Core, began: Match) -> None:
    """Refuse a file that is no more the match with which a run began; without the file its record has it."""
    if config.match is None or not os.path.exists(config.match):
        return
    now = match_for(config.wrap, core.spec, derive_spec(config.env), config.match)
    if now is None or now.pairing != began.pairing:
        raise ConfigError(
            f"the match {config.match} was edited since the run began",
            remedy="restore it, or give another {out}",
            topic="matches",
        )


def default_directory(config: TrainConfig) -> Path:
    """Name a run directory: `runs/<env>_<core or scratch>_<algo>_<preset>_seed<k>`, the preset without its version."""
    core = "scratch" if config.core is None else f"{Path(config.core).name}.{config.member}"
    name = f"{config.env}_{core}_{config.algo}_{preset_family(config.preset)}_seed{config.seed}"
    return RUNS / re.sub(r"[^\w.,=\[\]+-]+", "-", name).strip("-")[:LONGEST]


def _told(result: Result, out: Path) -> Result:
    """Say if the policy that was handed over is not the one of the run."""
    if result.fell_back or (result.probation and not result.probation.accepted):
        LOGGER.warning("the policy that was handed over is not the one of the run: load_policy(%r) loads that", str(out))
    return result


def _core_of(policy: Policy) -> tuple[Core | None, dict[str, Any]]:
    """The core that a policy was wrapped around, and what a record says of it."""
    origin = getattr(policy, "origin", None)
    if origin is None:
        return None, {}
    return origin.core, {"core": origin.core.id, "member": origin.member, "wrap": policy.config}


def _run(job: Job, report: Report | None) -> Result:
    job.check()
    job = job.on_probation()
    prior, ledger = job.experience()
    compiled = job.compiles()
    directory, checkpoint = job.open(ledger, compiled=compiled)
    with directory:
        if directory.result is not None:
            return directory.result
        job = job.with_untrained(directory, begun=checkpoint is not None)
        trainer = job.trainer(prior, compiled=compiled)
        session = job.session(directory, trainer, report)
        scores = train_and_evaluate(trainer, job.envs(trainer), session, checkpoint)
        directory.save_policy(job.trained(trainer, session))
        result = directory.finish(job.result(session, scores, ledger))
        job.warn(session)
        return result
