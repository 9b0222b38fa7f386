"""Train the members of a core, check each against the acceptance threshold, and write the artifact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from transferkit import stats
from transferkit.budget import given_limits
from transferkit.config.checks import AT_LEAST_ONE, MEMBERS, Different, Items, Seed, check
from transferkit.envs import derive_spec
from transferkit.errors import ArtifactError, ConfigError, SettingError
from transferkit.evaluation import evaluate
from transferkit.files import check_folder
from transferkit.policy.base import ScratchPolicy
from transferkit.policy.core import Core, stack_members
from transferkit.policy.saved import load_components, load_policy
from transferkit.run import RECORD, check_same, read_record
from transferkit.training import RUNS, run_training
from transferkit.versions import command, versions
from transferkit.workers import worker_pool
from transferkit.zoo.artifact import check_unreleased, components_card
from transferkit.zoo.card import SCORE_EPISODES, SCORE_SEED, Card, Score
from transferkit.zoo.release import check_name, release

if TYPE_CHECKING:
    from transferkit.config import TrainConfig
    from transferkit.policy.saved import Component
    from transferkit.run import Result


@dataclass(frozen=True)
class Recipe:
    """A core to make."""

    name: str
    """Name of the core without its version."""
    threshold: float
    """Mean return that every member has to reach."""
    version: Annotated[int, AT_LEAST_ONE] = 1
    """Version of the artifact; a released one is never rewritten."""
    seeds: Annotated[tuple[Seed, ...], Items(int(MEMBERS.high)), Different()] = (0, 1, 2, 3, 4)
    """Source seed of each member; none is left out afterwards."""
    zoo: Path = Path("zoo")
    """Folder the artifact goes into."""
    description: str = ""
    """One sentence for the card."""
    policy_only: bool = False
    """Leave out critics and model, which take five to ten times the space of the policy."""
    best: bool = False
    """Take of each member the best policy that its evaluations found, not the final one; they need `eval_every`."""
    workers: Annotated[int, AT_LEAST_ONE] = 2
    """Members trained at the same time."""

    def __post_init__(self) -> None:
        check(self)
        check_name(self.name)

    @property
    def id(self) -> str:
        """`<name>-v<version>`."""
        return f"{self.name}-v{self.version}"


def pretrain(recipe: Recipe, config: TrainConfig) -> Card:
    """Train, check and write a core; an interrupted call goes on where it stopped.

    Raises:
        ArtifactError: the version exists, or a member is below the threshold.
        ConfigError: a core cannot be made of what the configuration trains, or its folder cannot be written.
    """
    check_folder(recipe.zoo, "zoo")
    if config.core is not None:
        raise ConfigError("pretrain makes a core from scratch", remedy="leave out {core}")
    if config.algo != "ppo" and config.model.predict == "state":
        raise SettingError("model.predict", value="state", allowed="'change' for the model of a core")
    if config.stop_at is not None and config.stop_at < recipe.threshold:
        raise SettingError("stop_at", value=config.stop_at, allowed=f"at least the threshold {recipe.threshold:g}")
    if recipe.best and not config.eval_every:
        raise ConfigError("the best policy is found by evaluations during training", remedy="give {eval_every} with {best}")
    folder = recipe.zoo / recipe.id
    check_unreleased(folder)
    if config.algo == "dyna-ddpg" and not recipe.policy_only:
        config = replace(config, dyna=replace(config.dyna, keep_model=True))
    results = _train_members(recipe, config)
    loaded = [load_policy(result.run_dir, best=recipe.best) for result in results]
    policies = [policy for policy in loaded if isinstance(policy, ScratchPolicy)]
    returns = [
        evaluate(
            policy,
            config.env,
            episodes=SCORE_EPISODES,
            seed=SCORE_SEED,
            **asdict(config.env_config),
        ).returns
        for policy in policies
    ]
    score = _score(recipe, returns)
    beside = [{} if recipe.policy_only else load_components(result.run_dir, best=recipe.best) for result in results]
    core = _core(recipe, config, policies, beside)
    return release(core, _card(recipe, config, core, results, score), folder)


def _train_members(recipe: Recipe, config: TrainConfig) -> list[Result]:
    jobs = [(replace(config, seed=seed), RUNS / "pretrain" / recipe.id / f"seed{seed}") for seed in recipe.seeds]
    for job, out in jobs:
        _check_budget(job, out)
    if recipe.workers == 1 or len(jobs) == 1:
        return [run_training(job, out=out, resume=True) for job, out in jobs]
    with worker_pool(recipe.workers, len(jobs)) as pool:
        return list(pool.map(_train_member, *zip(*jobs, strict=True)))


def _check_budget(config: TrainConfig, out: Path) -> None:
    """Refuse a member that began with another budget: one that was given more later is not what the card's command makes."""
    if (out / RECORD).exists():
        check_same(out, given_limits(read_record(out)), given_limits(asdict(config)))


def _train_member(config: TrainConfig, out: Path) -> Result:
    return run_training(config, out=out, resume=True)


def _score(recipe: Recipe, returns: list[tuple[float, ...]]) -> Score:
    members = tuple(float(np.mean(member)) for member in returns)
    below = [f"seed {seed}: {mean:.1f}" for seed, mean in zip(recipe.seeds, members, strict=True) if mean < recipe.threshold]
    if below:
        raise ArtifactError(
            f"core {recipe.id} is refused: {', '.join(below)}, below the threshold {recipe.threshold:g} "
            f"(mean of all members {np.mean(members):.1f})",
            remedy="train longer, for example with more {steps}",
        )
    low, high = stats.hierarchical_interval(returns)
    return Score(float(np.mean(members)), low, high, SCORE_EPISODES, SCORE_SEED, members, recipe.threshold)


def _core(
    recipe: Recipe,
    config: TrainConfig,
    policies: Sequence[ScratchPolicy],
    beside: Sequence[dict[str, Component]],
) -> Core:
    stacked = {"policy": stack_members([policy.network.state_dict() for policy in policies])}
    statistics = [policy.normalizer.state_dict() for policy in policies if policy.normalizer is not None]
    if statistics:
        stacked["normalizer"] = stack_members(statistics)
    ensembles = {name: architecture for name, (architecture, _) in beside[0].items()}
    for name in ensembles:
        stacked[name] = stack_members([components[name][1] for components in beside])
    architecture = policies[0].network.architecture
    return Core(recipe.id, derive_spec(config.env), architecture, recipe.seeds, stacked, ensembles=ensembles)


def _card(recipe: Recipe, config: TrainConfig, core: Core, results: list[Result], score: Score) -> Card:
    components = components_card(core)
    best = ", each at its best evaluation" if recipe.best else ""
    return Card(
        id=recipe.id,
        description=recipe.description or f"Policies trained with {config.algo} on {config.env}.",
        source=core.spec,
        components=components,
        seeds=recipe.seeds,
        score=score,
        spent=tuple({"episodes": r.episodes, "steps": r.steps, "seconds": r.seconds} for r in results),
        command=command(),
        config=asdict(config),
        versions=versions(),
        files={},
        history=(f"v{recipe.version}: {', '.join(components)}; trained with {config.algo}{best}",),
    )
