"""Import policies of other libraries as cores: read, checked against zero action, scored, and written into a zoo."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from transferkit.budget import Spent
from transferkit.config import TrainConfig
from transferkit.config.checks import AT_LEAST_ONE, POSITIVE, check, check_kind, check_value
from transferkit.envs import derive_spec, name_of
from transferkit.errors import ArtifactError, SettingError
from transferkit.evaluation import ZeroPolicy, evaluate
from transferkit.interop import Given, read_core
from transferkit.policy.health import health
from transferkit.zoo.card import NOT_STATED, SCORE_EPISODES, SCORE_SEED, ImportedFrom
from transferkit.zoo.find import Played
from transferkit.zoo.release import check_place, core_id, new_card, release, scored

if TYPE_CHECKING:
    from transferkit.envs import EnvLike
    from transferkit.interop import Scale
    from transferkit.policy.core import Core

PROBATION = 5
"""Episodes that are compared with zero action from the same starts."""

USUAL = ("tanh", "relu", "elu")
"""Activations that policies of the libraries have."""


@dataclass(frozen=True)
class Target:
    """Where an imported core goes."""

    name: str
    version: Annotated[int, AT_LEAST_ONE] = 1
    zoo: Path = Path("zoo")
    threshold: float | None = None
    """Mean return that it has to reach."""
    licence: str = NOT_STATED

    def __post_init__(self) -> None:
        check(self)
        core_id(self.name, self.version)

    @property
    def folder(self) -> Path:
        """The folder of the artifact."""
        return self.zoo / core_id(self.name, self.version)


@dataclass(frozen=True)
class Imported:
    """A core that was imported, and what is to be said about it."""

    core: Core
    library: str
    """That wrote the file."""
    steps: int
    """Of its training, if the file says so."""
    notes: list[str]
    """What was assumed or left out."""
    warnings: list[str]
    """Signs that something was read wrongly."""
    returns: tuple[float, ...]
    zero: tuple[float, ...]
    """Returns of zero action, from the first of the same starts."""


def import_core(
    file: str | Path,
    *,
    env: EnvLike,
    name: str | None = None,
    version: int = 1,
    zoo: str | Path = "zoo",
    stats: str | Path | None = None,
    activation: str | None = None,
    action_scale: Scale | None = None,
    std: float | None = None,
    threshold: float | None = None,
    licence: str = NOT_STATED,
    descriptor: str | Path | None = None,
) -> Core:
    """Make a core of a policy that another library trained; nothing of its file is run.

    Args:
        file: of Stable-Baselines3 or SBX (zip, or flax's msgpack), rsl_rl, CleanRL (both torch's), or ONNX.
        env: the environment that it was trained in, in any form that `make_env` takes.
        name: write it into `zoo` as `<name>-v<version>`; without a name it stays in memory.
        version: of the artifact.
        zoo: folder of cores.
        stats: file of its observation statistics, VecNormalize's pickle or npz; `none` if there were none.
        activation: of its hidden layers.
        action_scale: the environment's units of an output of 1, or `bounds` if -1 to 1 span the environment's bounds.
        std: standard deviation of exploration, of an action range of [-1, 1].
        threshold: mean return over 20 episodes that it has to reach.
        licence: of the policy.
        descriptor: file that says what its numbers are: LEAPP YAML, or Isaac Lab's IO descriptors. Where the environment has
            them in another order, with another sign, unit or default pose, the core is changed to take them so.

    Raises:
        ArtifactError: the file is damaged or of another format, or the score is below the threshold.
        ConfigError: the file does not say something that is not given either.
        DimensionError: it does not fit the environment.
    """
    check_kind("file", file, (str, Path), "give the file that the library saved")
    target = None if name is None else Target(name, version, Path(zoo), threshold, licence)
    done = run_import(Path(file), env, Given(activation, stats, action_scale, std, descriptor), target)
    logger = logging.getLogger("transferkit")
    for said in filter(None, (done.notes, done.warnings)):
        logger.warning("%s: %s", file, "; ".join(said))
    return done.core


def run_import(file: Path, env: EnvLike, given: Given, target: Target | None) -> Imported:
    """Read a file, play it against zero action, and write it if there is a target."""
    if given.std is not None:
        check_value("std", given.std, Annotated[float, POSITIVE])
    scale = given.action_scale
    if scale not in (None, "bounds") and not (isinstance(scale, float | int) and 0 < scale < float("inf")):
        raise SettingError("action_scale", value=scale, allowed="a positive number, or bounds")
    if target is not None:
        check_place(target.folder)
    name = file.stem if target is None else target.folder.name
    core, foreign, notes = read_core(file, derive_spec(env), given, name)
    policy = core.policy()
    returns = evaluate(policy, env, episodes=PROBATION if target is None else SCORE_EPISODES, seed=SCORE_SEED).returns
    zero = evaluate(ZeroPolicy(core.spec.act_dim), env, episodes=PROBATION, seed=SCORE_SEED).returns
    warnings = [*_probation(returns, zero), *health(policy, env).warnings]
    if given.activation is not None or foreign.activation is None or foreign.usual:
        warnings += _better_with(core, env, returns)
    done = Imported(core, foreign.library, foreign.steps, notes, warnings, returns, zero)
    return done if target is None else replace(done, core=_written(done, name_of(env), target))


def _probation(returns: tuple[float, ...], zero: tuple[float, ...]) -> list[str]:
    better = Played(returns[:PROBATION], zero).better
    if better > PROBATION // 2:
        return []
    means = f"{np.mean(returns[:PROBATION]):.1f} against {np.mean(zero):.1f}"
    return [
        f"above zero action in {better} of {PROBATION} episodes ({means}): is it of this environment, and are activation, "
        "statistics and scale of actions right?"
    ]


def _better_with(core: Core, env: EnvLike, returns: tuple[float, ...]) -> list[str]:
    """Play it with the other usual activations, if its file does not say which it has."""
    signs = []
    for other in sorted({*USUAL} - {core.architecture.to_json()["activation"]}):
        architecture = replace(core.architecture, activation=other)  # pyright: ignore[reportCallIssue] - no composed one
        played = evaluate(replace(core, architecture=architecture).policy(), env, episodes=PROBATION, seed=SCORE_SEED).returns
        if all(theirs > own for theirs, own in zip(played, returns, strict=False)):
            signs.append(f"with activation {other} it returns {np.mean(played):.1f} and not {np.mean(returns[:PROBATION]):.1f}")
    return signs


def _written(done: Imported, env: str, target: Target) -> Core:
    """Write the artifact; returns the core with its digest."""
    core, score = done.core, scored([done.returns], target.threshold)
    if score.mean < score.threshold:
        raise ArtifactError(
            f"core {core.id} is refused: its return {score.mean:.1f} is below the threshold {score.threshold:g}",
            remedy="check {activation}, {stats} and {action_scale}",
        )
    card = new_card(
        core,
        score,
        TrainConfig(core.spec.env_id),
        [Spent(steps=done.steps)],
        description=f"A policy of {done.library} for {env}, imported.",
        licence=target.licence,
        history=tuple(done.notes),
        origin=ImportedFrom(done.library, core.digest),
    )
    return replace(core, digest=release(core, card, target.folder).digest)
