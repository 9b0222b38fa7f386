"""The match that a kind of adapter asks for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.errors import ConfigError
from transferkit.matching.files import check_match, check_pairing, in_canonical_names, load_match
from transferkit.matching.match import Match, compiled, numbers_of_robots, padded
from transferkit.matching.pair import pair
from transferkit.pairing import Pairing

if TYPE_CHECKING:
    from transferkit.config import WrapConfig
    from transferkit.spec import IOSpec


def find_pairing(config: WrapConfig, source: IOSpec, target: IOSpec) -> Pairing:
    """Pair a core's source with a target as a sandwich's settings say.

    Raises:
        ConfigError: their numbers are none that robots have.
    """
    with numbers_of_robots(source, target):
        found = pair(source, target, limbs=config.limbs, angles=config.angles, forces=config.forces, stagger=config.stagger)
        return replace(found, hold=config.hold or found.hold)


def match_for(
    config: WrapConfig, source: IOSpec, target: IOSpec, given: str | Path | Pairing | Match | None = None
) -> Match | None:
    """Make the match that a sandwich's adapters start from; None for random adapters.

    Args:
        config: the sandwich's settings.
        source: of the core.
        target: of the environment.
        given: a match in place of the one that is found, its pairing, or a file that holds one.

    Raises:
        ConfigError: a semantic adapter or a match that is given, and nothing matches; or a match of something else.
        UnknownNameError: the match names something that is not there.
    """
    if given is not None and config.adapter not in ("auto", "semantic"):
        raise ConfigError(f"{{match}} has no effect on {{wrap.adapter={config.adapter}}}", remedy="leave one of them out")
    if config.adapter == "random":
        return None
    if config.adapter == "pad":
        return padded(source, target)
    result = given if isinstance(given, Match) else compiled(_pairing(config, source, target, given), source, target)
    if not result.fits(source, target):
        raise ConfigError(f"the match is not of {source.env_id} and {target.env_id}", topic="matches")
    if result.holds:
        return result
    if given is not None:
        raise ConfigError("nothing in the match gives an input and drives an action", topic="matches")
    nothing = f"nothing in {target.env_id} means what {source.env_id}'s observations and actions mean"
    if config.adapter == "semantic":
        raise ConfigError(f"{{wrap.adapter=semantic}}: {nothing}", remedy="use {wrap.adapter=random}")
    if config.hold > 1:
        raise ConfigError(f"{{wrap.hold={config.hold}}} has no effect: {nothing}", remedy="leave it out")
    return None


def _pairing(config: WrapConfig, source: IOSpec, target: IOSpec, given: str | Path | Pairing | None) -> Pairing:
    if given is None:
        return find_pairing(config, source, target)
    if isinstance(given, Pairing):
        check_pairing(given)
    else:
        given = load_match(given)
    pairing = in_canonical_names(given, source, target)
    check_match(pairing, source, target)
    return pairing
