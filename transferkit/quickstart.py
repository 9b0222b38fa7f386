"""The main job in two minutes: a core works on its twin at once, one gets a robot going, one is refused where none crosses.

There a learner from scratch is what helps; it runs beside the rest, in a process of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit import stats
from transferkit.budget import Budget, Spent
from transferkit.config import TrainConfig
from transferkit.envs import derive_spec, make_env
from transferkit.evaluation import RandomPolicy, ZeroPolicy, evaluate
from transferkit.files import check_folder
from transferkit.plots import draw_learning_curves, draw_run
from transferkit.policy.make import wrap
from transferkit.probation import hold_probation
from transferkit.run import EpisodeRow, read_table
from transferkit.training import run_training
from transferkit.workers import worker_pool
from transferkit.zoo.artifact import load_core

if TYPE_CHECKING:
    from transferkit.envs import Actor
    from transferkit.evaluation import Evaluation
    from transferkit.policy.core import Core
    from transferkit.run import Report, Result

CORE, TWIN = "inverted-pendulum-v1", "dm_control/cartpole-balance-v0"
FITTING, ROBOT = "hopper-v1", "Walker2d-v5"
TWO_POLES = "InvertedDoublePendulum-v5"
EPISODES, STEPS = 200, 20_000
"""Budget of a training; the episodes are the paper's."""

TRAINED = TrainConfig(ROBOT, episodes=EPISODES, steps=STEPS, eval_every=4000, eval_episodes=5)
"""As in the study `ladder`."""

POLES = TrainConfig(TWO_POLES, algo="dyna-ddpg", episodes=60, steps=3000, eval_every=500, eval_episodes=5)
"""As in the study `dyna_v6`, but for a thousand steps."""

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

    twin: tuple[ZeroShot, ...]
    """The first core and its controls on its twin."""
    runs: tuple[Result, ...]
    """The second core and scratch on a robot with two legs."""
    zero_action: ZeroShot
    """Doing nothing there."""
    refused: str
    """Why the first core is not trained on two poles."""
    poles: Result
    """DYNA-DDPG from scratch there."""
    picture: str
    """Learning curves on the robot with two legs, a PNG."""
    poles_picture: str
    """And on two poles."""


def quickstart(out: Path, progress: Callable[[str, Budget], AbstractContextManager[Report]], *, seed: int = 0) -> Outcome:
    """Play a core on its twin, train another beside scratch, put the first on probation; repeated calls continue."""
    check_folder(out, "out")
    core = load_core(CORE)

    def train(name: str, config: TrainConfig) -> Result:
        with progress(f"{name} on {config.env}", Budget(config.episodes, config.steps)) as report:
            return run_training(replace(config, seed=seed), out=out / name, resume=True, report=report)

    with worker_pool(1, 1) as pool:
        beside = pool.submit(run_training, replace(POLES, seed=seed), out=out / "two-poles", resume=True)
        twin = zero_shot(core, TWIN, episodes=TWIN_EPISODES, seed=seed)
        runs = tuple(train(core_id or "scratch", replace(TRAINED, core=core_id)) for core_id in (FITTING, None))
        nothing = _summary("zero action", [evaluate(ZeroPolicy(derive_spec(ROBOT).act_dim), ROBOT, seed=0)])
        refused = _probation(core, seed)
        with progress(f"scratch on {TWO_POLES}", Budget(POLES.episodes, POLES.steps)) as report:
            poles = _awaited(beside, out / "two-poles", report)
    pictures = out / "learning_curves.png", out / "two_poles.png"
    curves = {run.core or "scratch": Path(run.run_dir) for run in runs}
    draw_learning_curves(curves, f"{ROBOT}, one seed", pictures[0], zero_action=nothing.mean)
    draw_run(Path(poles.run_dir), pictures[1])
    return Outcome(twin, runs, nothing, refused, poles, *map(str, pictures))


def _awaited(run: Future[Result], folder: Path, report: Report) -> Result:
    """Wait for a run beside this one, and report what it has spent."""
    while not run.done():
        wait([run], timeout=1.0)
        table = read_table(folder, EpisodeRow) if EpisodeRow.file(folder).exists() else {"episode": []}
        if len(table["episode"]):
            report(Spent(int(table["episode"][-1]), int(table["steps"][-1]), float(table["seconds"][-1])), {})
    return run.result()


def _probation(core: Core, seed: int) -> str:
    """What `train` would find of the core on two poles, and do."""
    policy, asked = wrap(core, TWO_POLES), TRAINED.wrap
    held = hold_probation(policy, lambda: make_env(TWO_POLES), Budget(EPISODES), asked.probation, seed, asked.least_gain)
    assert held is not None
    probation, _ = held
    return f"{'trusted' if probation.accepted else 'refused'}: {probation.reason}"


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
    low, high = stats.hierarchical_interval(groups)
    means = tuple(evaluation.mean for evaluation in evaluations)
    return ZeroShot(name, sum(means) / len(means), low, high, means)
