"""Which cores of the zoo an environment can represent, and how they play there untrained."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from transferkit.envs import derive_spec
from transferkit.errors import ConfigError, TransferkitError
from transferkit.evaluation import ZeroPolicy, evaluate
from transferkit.matching import compiled, coverage, distance, mean_reach
from transferkit.policy.make import wrap
from transferkit.policy.matches import match as pairing_of
from transferkit.zoo.artifact import load_core
from transferkit.zoo.catalog import list_cards

if TYPE_CHECKING:
    from transferkit.envs import EnvLike
    from transferkit.matching import Match
    from transferkit.spec import IOSpec
    from transferkit.zoo.card import Card

EPISODES = 5
"""Untrained episodes of a core, beside as many of zero action from the same starts."""


@dataclass(frozen=True)
class Found:
    """A core, and how much of it an environment can represent."""

    core: str
    source: str
    """Its environment."""
    inputs: float
    """Share of its inputs that mean something there."""
    actions: float
    """Share of its actions that drive something there."""
    hold: int
    """Control steps for which an action is held."""
    copies: int
    """How many limbs it drives side by side."""
    length: float
    """Lengths of its robot over those of the environment's."""
    forces: str
    """What its actions keep."""
    reach: float | None
    """Share of the ranges of its hinges that those of the environment reach, in the mean; None if it has or knows none."""
    distance: float | None
    """How far apart the two mechanisms are: 0 if they are one, 1 if no joint of either stands for one of the other.

    None of a core whose card knows neither masses nor ranges, as those of earlier versions.
    """

    @property
    def share(self) -> float:
        """How much of it can be represented."""
        return self.inputs * self.actions


@dataclass(frozen=True)
class Played:
    """Untrained episodes of a core's first member and of zero action, from the same starts."""

    returns: Sequence[float]
    zero: Sequence[float]

    @property
    def better(self) -> int:
        """Episodes in which the core is above zero action."""
        return sum(own > other for own, other in zip(self.returns, self.zero, strict=True))


def find_cores(env: EnvLike) -> tuple[list[Found], list[TransferkitError]]:
    """Rank the cores of the zoo by how much of them an environment can represent.

    First by inputs and actions, then by the ranges of hinges, then the environment's own, then by how near the robots are.

    Returns those of which anything can be, and what is wrong with cards that cannot be read or matched.

    Raises:
        UnknownNameError: no environment has this id.
        EnvironmentContractError: it cannot be put under the contract.
    """
    target, (cards, unread) = derive_spec(env), list_cards()
    found, errors = list[Found](), list[TransferkitError](unread)
    for card in cards:
        try:
            match = compiled(pairing_of(card.source, target), card.source, target)
        except ConfigError as error:
            errors.append(ConfigError(f"core {card.id}: {error}"))
            continue
        if match.holds:
            found.append(_found(card, match, target))
    return sorted(found, key=partial(_order, target.env_id)), errors


def _order(env_id: str, found: Found) -> tuple[float, float, bool, float]:
    """What is not known is taken as if all was reached, and nothing alike."""
    reached = 1.0 if found.reach is None else found.reach
    return -found.share, -reached, found.source != env_id, 1.0 if found.distance is None else found.distance


def _found(card: Card, match: Match, target: IOSpec) -> Found:
    assert match.pairing is not None
    (inputs, actions), pairing = coverage(match, card.source), match.pairing
    reached, known = mean_reach(match, card.source, target), any(joint.mass for joint in card.source.joints)
    return Found(
        core=card.id,
        source=card.source.env_id,
        inputs=inputs,
        actions=actions,
        hold=match.hold,
        copies=match.copies,
        length=round(pairing.length, 4),
        forces=pairing.forces,
        reach=None if reached is None else round(reached, 4),
        distance=round(distance(card.source, target), 4) if known else None,
    )


def play_found(
    found: Sequence[Found], env: EnvLike, *, report: Callable[[int, int], None] | None = None
) -> tuple[dict[str, Played], list[TransferkitError]]:
    """Play each core untrained, and zero action beside it.

    Returns what came of those that could be played, by core, and what is wrong with the others.
    """
    zero = evaluate(ZeroPolicy(derive_spec(env).act_dim), env, episodes=EPISODES).returns
    played, errors = dict[str, Played](), list[TransferkitError]()
    for k, one in enumerate(found):
        try:
            played[one.core] = Played(evaluate(wrap(load_core(one.core), env), env, episodes=EPISODES).returns, zero)
        except TransferkitError as error:
            errors.append(error)
        if report is not None:
            report(k + 1, len(found))
    return played, errors
