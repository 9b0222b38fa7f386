"""Train the members of a core, check each against the acceptance threshold, and write the artifact."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from transferkit.budget import Spent, given_limits
from transferkit.config.checks import AT_LEAST_ONE, MEMBERS, Different, Items, Seed, check
from transferkit.envs import derive_spec
from transferkit.errors import ArtifactError, ConfigError, SettingError, TransferkitError
from transferkit.evaluation import evaluate
from transferkit.policy.base import ScratchPolicy
from transferkit.policy.core import Core, stack_members
from transferkit.policy.saved import load_components, load_policy
from transferkit.run import check_same, is_run, read_record
from transferkit.training import RUNS, run_training
from transferkit.workers import worker_pool
from transferkit.zoo.card import SCORE_EPISODES, SCORE_SEED
from transferkit.zoo.release import check_place, core_id, new_card, release, scored

if TYPE_CHECKING:
    from transferkit.config import TrainConfig
    from transferkit.policy.saved import Component
    from transferkit.run import Result
    from transferkit.zoo.card import Card, Score


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
        core_id(self.name, self.version)

    @property
    def id(self) -> str:
        """The core's."""
        return core_id(self.name, self.version)


def pretrain(recipe: Recipe, config: TrainConfig) -> Card:
    """Train, check and write a core; an interrupted call goes on where it stopped.

    Raises:
        ArtifactError: the version exists, or a member is below the threshold.
        ConfigError: a core cannot be made of what the configuration trains, or its folder cannot be written.
    """
    folder = recipe.zoo / recipe.id
    check_place(folder)
    if config.core is not None:
        raise ConfigError("pretrain makes a core from scratch", remedy="leave out {core}")
    if config.seed:
        raise ConfigError(f"{{seed={config.seed}}} has no effect: each member has its own", remedy="give {seeds}")
    if config.algo != "ppo" and config.model.predict == "state":
        raise SettingError("model.predict", value="state", allowed="'change' for the model of a core")
    if config.stop_at is not None and config.stop_at < recipe.threshold:
        raise SettingError("stop_at", value=config.stop_at, allowed=f"at least the threshold {recipe.threshold:g}")
    if recipe.best and not config.eval_every:
        raise ConfigError("the best policy is found by evaluations during training", remedy="give {eval_every} with {best}")
    if config.algo == "dyna-ddpg" and not recipe.policy_only:
        config = replace(config, dyna=replace(config.dyna, keep_model=True))
    try:
        results = _train_members(recipe, config)
    except TransferkitError as error:
        error.remedy = error.remedy.replace("another {out}", "another {name}")  # which the members' folders are named by
        raise
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
    score = scored(returns, recipe.threshold)
    _check_score(recipe, score)
    beside = [{} if recipe.policy_only else load_components(result.run_dir, best=recipe.best) for result in results]
    core = _core(recipe, config, policies, beside)
    best = ", each at its best evaluation" if recipe.best else ""
    card = new_card(
        core,
        score,
        config,
        [Spent(result.episodes, result.steps, result.seconds) for result in results],
        description=recipe.description or f"Policies trained with {config.algo} on {config.env}.",
        history=(f"v{recipe.version}: {', '.join(core.components)}; trained with {config.algo}{best}",),
    )
    return release(core, card, folder)


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
    if is_run(out):
        check_same(out, given_limits(read_record(out)), given_limits(asdict(config)))


def _train_member(config: TrainConfig, out: Path) -> Result:
    return run_training(config, out=out, resume=True)


def _check_score(recipe: Recipe, score: Score) -> None:
    means = zip(recipe.seeds, score.members, strict=True)
    if below := [f"seed {seed}: {mean:.1f}" for seed, mean in means if mean < recipe.threshold]:
        raise ArtifactError(
            f"core {recipe.id} is refused: {', '.join(below)}, below the threshold {recipe.threshold:g} "
            f"(mean of all members {score.mean:.1f})",
            remedy=f"train longer: remove {RUNS / 'pretrain' / recipe.id} and give more {{steps}}",
        )


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
