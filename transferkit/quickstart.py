"""The main job in two minutes: a core works on its twin at once, and does not help on two poles, which are soon solved."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit import stats
from transferkit.budget import Budget
from transferkit.config import TrainConfig
from transferkit.envs import derive_spec
from transferkit.evaluation import RandomPolicy, ZeroPolicy, evaluate
from transferkit.files import check_folder
from transferkit.plots import draw_learning_curves, draw_run
from transferkit.policy.make import wrap
from transferkit.training import run_training
from transferkit.zoo.artifact import load_core

if TYPE_CHECKING:
    from transferkit.envs import Actor
    from transferkit.evaluation import Evaluation
    from transferkit.policy.core import Core
    from transferkit.run import Report, Result

CORE, TWIN, TARGET = "inverted-pendulum-v1", "dm_control/cartpole-balance-v0", "InvertedDoublePendulum-v5"
EPISODES = 200
"""Budget on the target; the paper's."""

SOLVED = 9300.0
"""Return of a target that is solved, of 9360."""

LEARNER = TrainConfig(TARGET, algo="dyna-ddpg", episodes=EPISODES, steps=2900, eval_every=500, stop_at=SOLVED)
"""How the target is solved from scratch."""

TWIN_EPISODES = 2
"""Evaluation episodes per member on the twin; 1000 steps each."""


@dataclass(frozen=True)
class ZeroShot:
    """Returns on a target before any target step."""

    who: str
    mean: float
    low: float
    high: float
    members: tuple[float, ...]
    """Mean of each member; a single one if there are no members."""


@dataclass(frozen=True)
class Outcome:
    """Everything that the quickstart measured."""

    core: str
    twin_task: tuple[str, int]
    """Environment, and evaluation episodes per member."""
    target_task: tuple[str, int]
    """Environment, and training episodes."""
    twin: tuple[ZeroShot, ...]
    """The core and its controls on the twin."""
    runs: tuple[Result, ...]
    """Core and scratch on the target, with PPO."""
    threshold: float
    """Evaluation from which the target is solved."""
    solved: Result
    """Scratch on the target, with DYNA-DDPG until it is solved."""
    zero_action: ZeroShot
    """Doing nothing on the target."""
    picture: str
    """Learning curves of PPO, a PNG."""
    solved_picture: str
    """Evaluations of DYNA-DDPG, a PNG."""


def quickstart(out: Path, progress: Callable[[str, Budget], AbstractContextManager[Report]], *, seed: int = 0) -> Outcome:
    """Play the core on its twin, train it and a scratch policy on the target, and solve that; repeated calls continue."""
    check_folder(out, "out")
    core = load_core(CORE)
    twin = zero_shot(core, TWIN, episodes=TWIN_EPISODES, seed=seed)

    def train(name: str, config: TrainConfig) -> Result:
        with progress(f"{name} on {TARGET}", Budget(config.episodes, config.steps)) as report:
            return run_training(replace(config, seed=seed), out=out / name, resume=True, report=report)

    runs = tuple(train(core_id or "scratch", TrainConfig(TARGET, core=core_id, episodes=EPISODES)) for core_id in (CORE, None))
    solved = train("dyna-ddpg", LEARNER)
    nothing = _summary("zero action", [evaluate(ZeroPolicy(1), TARGET, seed=0)])
    picture = out / "learning_curves.png"
    curves = {run.core or "scratch": Path(run.run_dir) for run in runs}
    draw_learning_curves(curves, f"{TARGET}, one seed", picture, zero_action=nothing.mean)
    draw_run(Path(solved.run_dir), solved_picture := out / "solved.png")
    tasks = (TWIN, TWIN_EPISODES), (TARGET, EPISODES)
    return Outcome(CORE, *tasks, twin, runs, SOLVED, solved, nothing, str(picture), str(solved_picture))


def zero_shot(core: Core, env: str, *, episodes: int, seed: int = 0) -> tuple[ZeroShot, ...]:
    """Play every member of a core on a target before any target step, beside its controls.

    Controls: the same sandwich around a core with shuffled and with random weights, uniform actions, no action.
    """
    target = derive_spec(env)

    def play(name: str, actors: Sequence[Actor]) -> ZeroShot:
        return _summary(name, [evaluate(actor, env, episodes=episodes, seed=seed) for actor in actors])

    def members(name: str, variant: Core) -> ZeroShot:
        return play(name, [wrap(variant, target, member=member) for member in range(len(core.seeds))])

    return (
        members("core", core),
        members("shuffled core", core.shuffled(seed)),
        members("random core", core.randomized(seed)),
        play("random actions", [RandomPolicy(target.act_dim, seed)]),
        play("zero action", [ZeroPolicy(target.act_dim)]),
    )


def _summary(name: str, evaluations: Sequence[Evaluation]) -> ZeroShot:
    groups = [evaluation.returns for evaluation in evaluations]
    low, high = stats.hierarchical_interval(groups) if len(groups) > 1 else stats.mean_interval(groups[0])
    means = tuple(evaluation.mean for evaluation in evaluations)
    return ZeroShot(name, sum(means) / len(means), low, high, means)
