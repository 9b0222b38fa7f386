"""`distill`: students of all members of a teacher, checked and written as a core."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from transferkit.config import TrainConfig
from transferkit.config.checks import check_kind
from transferkit.distillation.config import DistillConfig
from transferkit.distillation.rounds import Rounds
from transferkit.distillation.teacher import BesideStudent, teacher_in, watch
from transferkit.envs import copies_of, derive_spec
from transferkit.errors import ArtifactError, ConfigError, SettingError
from transferkit.evaluation import evaluate
from transferkit.files import writing
from transferkit.nn.gaussian import LOG_STD_BOUNDS
from transferkit.policy.core import Core, stack_members
from transferkit.run import named_run
from transferkit.training import RUNS
from transferkit.zoo.card import NOT_STATED, SCORE_EPISODES, SCORE_SEED
from transferkit.zoo.catalog import find_card
from transferkit.zoo.release import check_place, new_card, release, scored

if TYPE_CHECKING:
    from transferkit.budget import Spent
    from transferkit.envs import EnvLike
    from transferkit.policy.base import ScratchPolicy
    from transferkit.run import Report
    from transferkit.zoo.card import Card


@dataclass(frozen=True)
class Distilled:
    """A core that was distilled, beside its teacher."""

    card: Card
    teacher: tuple[float, ...]
    """Mean return of each member's teacher over the same starts, with its own observations."""

    @property
    def pairs(self) -> list[tuple[float, float]]:
        """Mean returns of each student and of its teacher."""
        return list(zip(self.card.score.members, self.teacher, strict=True))


@dataclass(frozen=True)
class _Student:
    policy: ScratchPolicy
    returns: tuple[float, ...]
    teacher_return: float
    spent: Spent


def distill(teacher: str, env: EnvLike, recipe: DistillConfig, *, report: Report | None = None) -> Distilled:
    """Train a policy that sees less, or something else, to do what one does that sees all (DAgger); write it as a core.

    The teacher plays in the environment that is innermost in `env`, the student through all of its wrappers: a sensor that is
    dropped, noise, a stack of frames in place of velocities. An interrupted call goes on after its last round.

    Args:
        teacher: a core's id or folder, or the directory of a finished run.
        env: the student's environment, in any form that `make_env` takes, such as
            `HalfCheetah-v5?vary.drop_observation=[8]&vary.frames=4`.
        recipe: name and budget.
        report: called after each round with what the member has spent.

    Raises:
        ArtifactError: the version exists, or a member is below the threshold.
        ConfigError: the teacher cannot act within this environment, or the folder cannot be written.
        UnknownNameError: neither a run nor a core has this name.
    """
    check_kind("recipe", recipe, DistillConfig, "make one, such as DistillConfig('mine')")
    check_place(recipe.folder)
    members = _members(teacher, recipe)
    work = RUNS / "distill" / recipe.folder.name
    with writing(work):
        work.mkdir(parents=True, exist_ok=True)
    spec = derive_spec(env)
    about = {"teacher": teacher, "env": spec.env_id, "recipe": _plain(recipe)}
    students = [_student(teacher, env, member, recipe, work, about, report) for member in members]
    own = find_card(teacher).seeds if _has_card(teacher) else ()
    seeds = tuple(own[member] if own and member is not None else recipe.seed for member in members)
    components = {
        "policy": stack_members([one.policy.network.state_dict() for one in students]),
        "normalizer": stack_members([one.policy.normalizer.state_dict() for one in students if one.policy.normalizer]),
    }
    core = Core(recipe.folder.name, spec, students[0].policy.network.architecture, seeds, components)
    card = release(core, _card(teacher, recipe, core, students), recipe.folder)
    shutil.rmtree(work, ignore_errors=True)
    return Distilled(card, tuple(one.teacher_return for one in students))


def _members(teacher: str, recipe: DistillConfig) -> Sequence[int | None]:
    if not _has_card(teacher):
        if recipe.members and named_run(teacher):
            raise ConfigError(f"run {teacher} has no members", remedy="leave out {members}")
        return recipe.members or [None]
    known = range(len(find_card(teacher).seeds))
    for member in recipe.members or ():
        if member not in known:
            raise SettingError("members", value=member, allowed=f"0 to {known[-1]} for core {teacher}")
    return known if recipe.members is None else recipe.members


def _has_card(teacher: str) -> bool:
    """Whether it is a core of a zoo, and no run and no file of another library."""
    return not (named_run(teacher) or Path(teacher).is_file())


def _student(
    name: str, env: EnvLike, member: int | None, recipe: DistillConfig, work: Path, about: dict[str, Any], report: Report | None
) -> _Student:
    subject = teacher_in(name, env, member, best=recipe.best)
    about = about | {"member": member, "by": dict(subject.about or {})}
    rounds = Rounds(recipe, env, subject.policy, work / f"member{member or 0}.safetensors", about)
    student = rounds.run(report)
    student.network.log_std.data.fill_(max(np.log(max(rounds.loss, 1e-12)) / 2, LOG_STD_BOUNDS[0]))
    returns = evaluate(student, env, episodes=SCORE_EPISODES, seed=SCORE_SEED).returns
    made, watched = watch(copies_of(env))
    taught = evaluate(BesideStudent(subject.policy, watched), made, episodes=SCORE_EPISODES, seed=SCORE_SEED).mean
    made.close()
    return _Student(student, returns, taught, rounds.spent)


def _card(name: str, recipe: DistillConfig, core: Core, students: Sequence[_Student]) -> Card:
    score = scored([one.returns for one in students], recipe.threshold)
    if min(score.members) < score.threshold:
        pairs = zip(score.members, students, strict=True)
        taught = ", ".join(f"{mean:.1f} of {one.teacher_return:.1f}" for mean, one in pairs)
        raise ArtifactError(
            f"core {core.id} is refused: the students return {taught}, below the threshold {score.threshold:g}",
            remedy="give more {steps}",
        )
    taught = float(np.mean([one.teacher_return for one in students]))
    return new_card(
        core,
        score,
        TrainConfig(core.spec.env_id),
        [one.spent for one in students],
        description=f"{name} on other observations: {core.spec.env_id}.",
        licence=find_card(name).licence if _has_card(name) else NOT_STATED,
        history=(f"v{recipe.version}: distilled from {name}, which returns {taught:.1f} from the same starts",),
    )


def _plain(recipe: DistillConfig) -> dict[str, Any]:
    """What of a recipe makes a student."""
    given = asdict(replace(recipe, threshold=None, members=None))
    return {name: list(value) if isinstance(value, tuple) else value for name, value in given.items() if name != "zoo"}
