"""Composition root: core, target and configuration to a policy, a trainer, an evaluation and a run directory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import torch
from torch import nn

from transferkit.budget import Budget
from transferkit.config import Algorithm, DynaConfig, PPOConfig, Preset, TrainConfig, preset
from transferkit.envs import VectorEnv, derive_spec, make_env
from transferkit.errors import ConfigError
from transferkit.evaluation import evaluate
from transferkit.policy import Policy
from transferkit.policy.core import Core
from transferkit.policy.parts import make_critic, make_dynamics
from transferkit.run.directory import CHECKPOINT, RECORD, RESULT, RunDirectory, read_json
from transferkit.run.session import Report, Session
from transferkit.run.streams import Streams
from transferkit.trained import as_saved, new_policy, state_of
from transferkit.zoo.artifact import load_core

RUNS = Path("runs")
"""Where run directories go that are not named."""

if TYPE_CHECKING:
    from transferkit.record.reader import Transitions

MakeEnv = Callable[[], gymnasium.Env]


@dataclass(frozen=True)
class Result:
    """What a finished training run came to."""

    algo: str
    preset: str
    core: str | None
    core_digest: str | None
    member: int | None
    env: str
    seed: int
    episodes: int
    """Completed training episodes."""
    steps: int
    """Environment steps of training."""
    seconds: float
    """Of training, evaluation not counted."""
    eval_return_mean: float
    eval_return_std: float
    eval_return_low: float
    """Student's 95 % interval of the mean over evaluation episodes."""
    eval_return_high: float
    eval_episodes: int
    run_dir: str
    prior_steps: int = 0
    """Steps of recordings that training started with; in no other count."""


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
        policy: an untrained one in place of that which the configuration describes: a control.
        out: its directory; by default `runs/` with a name made of the configuration.
        resume: go on where the directory stopped, start where there is none, return the result where it is finished.
        report: called after every update.
        record_every: record an episode of every so many evaluations as `recordings/step_<N>.mcap` in the run directory.

    Raises:
        TransferkitError: any of its kinds; see `transferkit.errors`.
    """
    budget = Budget(config.episodes, config.steps, config.seconds)
    core = None if config.core is None else load_core(config.core)
    make = lambda: make_env(config.env, clip_actions=config.ppo.clip_actions)  # noqa: E731 - a factory of this run
    make_policy = lambda: new_policy(config, core) if policy is None else policy  # noqa: E731
    return _execute(make_policy, make, budget, config, core, out, resume=resume, report=report, record_every=record_every)


def train(
    policy: Policy,
    env: str | MakeEnv,
    budget: Budget,
    *,
    algo: Algorithm = "ppo",
    preset_name: Preset = "default",
    config: PPOConfig | DynaConfig | None = None,
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
        policy: from `wrap`, or a `ScratchPolicy`.
        env: an id, or a function that makes one environment.
        budget: episodes, steps or seconds; the first one reached ends training.
        algo: the trainer.
        preset_name: which trainer settings to use.
        config: trainer settings in place of the preset's.
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
    name = env if isinstance(env, str) else _factory_name(env)
    full = preset(TrainConfig(name, algo=algo, seed=seed, device=device), preset_name)
    full = replace(full, **asdict(budget), eval_episodes=eval_episodes, eval_every=eval_every, stop_at=stop_at)
    if config is not None:
        if isinstance(config, PPOConfig) != (algo == "ppo"):
            raise ConfigError(f"config is a {type(config).__name__}, which algo='{algo}' does not take; pass algo= to match")
        full = replace(full, **{"ppo" if isinstance(config, PPOConfig) else "dyna": config})
    make = lambda: make_env(env if isinstance(env, str) else env(), clip_actions=full.ppo.clip_actions)  # noqa: E731
    where = None if out is None else Path(out)
    return _execute(lambda: policy, make, budget, full, None, where, resume=resume, report=report)


def default_directory(config: TrainConfig) -> Path:
    """`runs/<env>_<core or scratch>_<algo>_<preset>_seed<k>`."""
    core = "scratch" if config.core is None else f"{Path(config.core).name}.{config.member}"
    env = config.env.replace("/", "-")
    return RUNS / f"{env}_{core}_{config.algo}_{config.preset}_seed{config.seed}"


def _execute(
    make_policy: Callable[[], Policy],
    make: MakeEnv,
    budget: Budget,
    config: TrainConfig,
    core: Core | None,
    out: Path | None,
    *,
    resume: bool,
    report: Report | None,
    record_every: int = 0,
) -> Result:
    device = _device(config.device)
    torch.set_num_threads(1)  # the fastest for small networks, and the only number that always gives the same bits
    policy = make_policy()
    first = make()
    _check_dims(policy, first, config.env)
    out = out or default_directory(config)
    prior, ledger = _experience(config, out, resume=resume)
    record = {**asdict(config), "policy": policy.blueprint(), "core_digest": core.digest if core else None}
    record |= {"recordings": ledger} if ledger else {}
    directory, state = _open(out, record, resume=resume)
    try:
        if directory.result is not None:
            return Result(**directory.result)
        streams = Streams(config.seed)
        trainer = _trainer(config, policy, make, streams, prior)
        envs = VectorEnv(
            [first, *(make() for _ in range(trainer.num_envs - 1))],
            lambda i, k: streams.integer("environment", i, k),
            overrun_steps=trainer.overrun_steps,
        )
        session = Session(
            directory,
            budget,
            envs.num_envs,
            evaluate=partial(_evaluate, policy, make, config, record_every),
            eval_every=config.eval_every,
            stop_at=config.stop_at,
            checkpoint_seconds=config.checkpoint_seconds,
            report=report,
        )
        if state is not None:
            session.restore(state["session"])
        with session.running():
            if state is None and config.eval_every:
                session.evaluate()  # what is there before any training: the jumpstart
            parts = trainer.train(envs, session, streams, device, state and state["trainer"])
            scores = session.evaluate()
        envs.close()
        directory.save_policy(state_of(policy, parts))
        result = _result(config, core, session, scores, directory, sum(entry["steps"] for entry in ledger))
        directory.finish(asdict(result))
        return result
    finally:
        directory.close()


def _evaluate(policy: Policy, make: MakeEnv, config: TrainConfig, record_every: int, session: Session) -> Mapping[str, float]:
    saved = as_saved(policy)
    if record_every and session.evaluations % record_every == 0:
        from transferkit.record.play import record_evaluation  # noqa: PLC0415 - only few runs are recorded

        run = session.directory.path
        about = {"run": str(run), "core": config.core, "training_seed": config.seed}
        record_evaluation(saved, config.env, config.ppo.clip_actions, about, run, session.spent.steps)
    return evaluate(saved, make, episodes=config.eval_episodes).row()


@dataclass(frozen=True)
class _Trainer:
    train: Callable[..., Mapping[str, nn.Module]]
    """Returns what it trained beside the policy."""
    num_envs: int = 1
    overrun_steps: int = 0


def _trainer(config: TrainConfig, policy: Policy, make: MakeEnv, streams: Streams, prior: Transitions | None) -> _Trainer:
    if config.algo == "ppo":
        from transferkit import ppo  # noqa: PLC0415 - rsl_rl takes seconds to import

        train = lambda envs, *rest: ppo.train(policy, envs, config.ppo, *rest)  # noqa: E731
        return _Trainer(train, config.ppo.num_envs)
    spec = derive_spec(make())
    settings = config.dyna.for_time_step(spec.time_step)
    model = make_dynamics(policy, spec, settings, streams.torch("model initialisation"))
    if config.algo == "dyna-ppo":
        from transferkit import dyna_ppo  # noqa: PLC0415

        configs = config.ppo, settings
        train = lambda envs, *rest: dyna_ppo.train(policy, model, envs, configs, *rest)  # noqa: E731
        return _Trainer(train)
    from transferkit import dyna  # noqa: PLC0415

    critic = make_critic(policy, settings, streams.torch("critic initialisation"))
    rows = None if prior is None else dyna.Batch(*map(torch.from_numpy, prior.batch()))
    train = lambda envs, *rest: dyna.train(policy, critic, model, envs, settings, *rest, prior=rows)  # noqa: E731
    return _Trainer(train, 1, config.dyna.overrun_steps)


def _experience(config: TrainConfig, out: Path, *, resume: bool) -> tuple[Transitions | None, list[dict[str, Any]]]:
    """What to start with and where it is from; a run that has a checkpoint needs its recordings no more."""
    if not config.experience:
        return None, []
    if resume and ((out / CHECKPOINT).exists() or (out / RESULT).exists()):
        return None, read_json(out / RECORD)["config"].get("recordings", [])
    from transferkit.record.experience import load_experience  # noqa: PLC0415 - only few runs read recordings

    found, ledger = load_experience(config.experience, config.mapping, derive_spec(config.env))
    if len(found) > config.dyna.buffer_size:
        raise ConfigError(f"{len(found)} steps of experience do not fit; pass a larger --dyna.buffer-size")
    return found, ledger


def _open(out: Path, record: dict[str, Any], *, resume: bool) -> tuple[RunDirectory, Any]:
    if resume and (out / RECORD).exists():
        return RunDirectory.resume(out, record)
    return RunDirectory.create(out, record), None


def _check_dims(policy: Policy, env: gymnasium.Env, name: str) -> None:
    assert env.observation_space.shape is not None
    assert env.action_space.shape is not None
    needed = env.observation_space.shape[0], env.action_space.shape[0]
    if (policy.obs_dim, policy.act_dim) != needed:
        raise ConfigError(
            f"the policy takes {policy.obs_dim} observations and {policy.act_dim} actions, environment {name} has "
            f"{needed[0]} and {needed[1]}; build it with wrap(core, '{name}')"
        )


def _device(name: str) -> torch.device:
    try:
        device = torch.device(name)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0]
        raise ConfigError(f"device '{name}' cannot be used ({reason}); pass --device cpu") from None
    return device


def _factory_name(env: MakeEnv) -> str:
    return getattr(env, "__name__", type(env).__name__)


def _result(
    config: TrainConfig,
    core: Core | None,
    session: Session,
    scores: Mapping[str, float],
    directory: RunDirectory,
    prior_steps: int,
) -> Result:
    return Result(
        algo=config.algo,
        preset=config.preset,
        core=config.core,
        core_digest=core.digest if core else None,
        member=config.member if core else None,
        env=config.env,
        seed=config.seed,
        episodes=session.spent.episodes,
        steps=session.spent.steps,
        seconds=round(session.spent.seconds, 3),
        eval_return_mean=scores["return_mean"],
        eval_return_std=scores["return_std"],
        eval_return_low=scores["return_low"],
        eval_return_high=scores["return_high"],
        eval_episodes=int(scores["n"]),
        run_dir=str(directory.path),
        prior_steps=prior_steps,
    )
