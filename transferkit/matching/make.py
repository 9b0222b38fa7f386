"""The match that a kind of adapter asks for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from transferkit.errors import ConfigError
from transferkit.matching.match import compiled, padded
from transferkit.matching.pair import pair

if TYPE_CHECKING:
    from transferkit.config import WrapConfig
    from transferkit.matching.match import Match
    from transferkit.pairing import Pairing
    from transferkit.spec import IOSpec


def match_for(config: WrapConfig, source: IOSpec, target: IOSpec, pairing: Pairing | None = None) -> Match | None:
    """Make the match that a sandwich's adapters start from, of a pairing if one is given; None for random adapters.

    Raises:
        ConfigError: a semantic adapter, and nothing matches.
    """
    if config.adapter == "random":
        return None
    if config.adapter == "pad":
        return padded(source, target)
    if pairing is None:
        options = {name: getattr(config, name) for name in ("limbs", "angles", "forces", "stagger")}
        pairing = pair(source, target, **options)
        pairing = replace(pairing, hold=config.hold or pairing.hold)
    result = compiled(pairing, source, target)
    if result.holds:
        return result
    if config.adapter == "semantic":
        raise ConfigError(
            f"{{wrap.adapter=semantic}}: nothing in {target.env_id} means what {source.env_id}'s observations and actions mean",
            remedy="use {wrap.adapter=random}",
        )
    return None
