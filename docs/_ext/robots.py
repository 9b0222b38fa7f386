"""The page of robot pairs: a core on its own robot and on another, with what was measured there."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import core_zoo
from transferkit.zoo.card import read_card
from transferkit.zoo.crossings import read_crossings

if TYPE_CHECKING:
    from transferkit.zoo.crossings import Crossings

HEAD = """# What crosses, robot by robot

Generated from the study `zero_shot`: a core on its own robot and, untrained, on another one. Pictures
are of the first member's first four seconds (`python -m experiments.strips`), figures are mean
returns of all members over {episodes} episodes each. It *crosses* if every member is above every
control there, which says above, and not well. Every core on every target is in the map on the front
page and in [the cores](cores.md).
"""


@dataclass(frozen=True)
class Pair:
    """A section."""

    title: str
    text: str
    core: str
    target: str


PAIRS = (
    Pair(
        "A pole on a cart, and its twin",
        "The same mechanism in another suite, written by other people: every input and the action have a counterpart.",
        "inverted-pendulum-v2",
        "dm_control/cartpole-balance-v0",
    ),
    Pair(
        "A swing-up that balances elsewhere",
        "A core that swings a pole up also holds one that stands already, on the other suite's cart.",
        "cartpole-swingup-v2",
        "InvertedPendulum-v5",
    ),
    Pair(
        "One leg drives two",
        "The hopper's core acts twice, once in each leg of a walker, which hops on both.",
        "hopper-v1",
        "Walker2d-v5",
    ),
    Pair(
        "One leg, and a walker that shall stand",
        "The other suite's walker has other lengths, and a task that rewards an upright torso. It falls, later than others do.",
        "hopper-v1",
        "dm_control/walker-stand-v0",
    ),
    Pair(
        "Two hoppers",
        "The other suite's hopper has a waist more and begins in any pose. It does not stand up.",
        "hopper-v1",
        "dm_control/hopper-stand-v0",
    ),
    Pair(
        "Two legs, and one",
        "In one suite, with one sort of hips: what stands up on two legs gets up on one for moments. It stands for both.",
        "walker-stand-v1",
        "dm_control/hopper-stand-v0",
    ),
    Pair(
        "One leg, and two",
        "The other way round it does not cross: what gets up on one leg does not on two, and is below doing nothing.",
        "hopper-stand-v1",
        "dm_control/walker-stand-v0",
    ),
    Pair(
        "Two cheetahs",
        "All joints have counterparts. The front thigh of the one hardly bends forwards (0.007 rad against 0.7), its floor is "
        "less slippery: the core, which knows one body, stumbles.",
        "half-cheetah-v1",
        "dm_control/cheetah-run-v0",
    ),
    Pair(
        "Two walkers, from the suite to Gymnasium",
        "All joints have counterparts. The walk does not cross: two of three members fall at once.",
        "walker-walk-v1",
        "Walker2d-v5",
    ),
    Pair(
        "Two walkers",
        "All joints have counterparts, and the gait does not cross: it is no better than a shuffled core.",
        "walker2d-v1",
        "dm_control/walker-walk-v0",
    ),
)


def page() -> str:
    """Write Markdown."""
    crossings = read_crossings(Path(core_zoo.__path__[0]))
    assert crossings is not None
    return HEAD.format(episodes=crossings.episodes) + "".join(_section(pair, crossings) for pair in PAIRS)


def _section(pair: Pair, crossings: Crossings) -> str:
    (found,) = [one for one in crossings.cores[pair.core] if one.target == pair.target]
    home = read_card(Path(core_zoo.__path__[0]) / pair.core).source.env_id
    short = pair.target.rpartition("/")[2].removesuffix("-v0").removesuffix("-v5")
    members = ", ".join(f"{one:.0f}" for one in found.members)
    control = f"{found.control_mean:.0f} ({found.control})"
    return f"""
## {pair.title}

{pair.text}

![{pair.core} on {home}](images/robots/{pair.core}.png)

*`{pair.core}` on {home}*

![{pair.core} on {pair.target}](images/robots/{pair.core}_{short}.png)

*and untrained on {pair.target}*

| core | members | zero action | best control | crosses |
|---|---|---|---|---|
| {found.mean:.0f} | {members} | {found.zero:.0f} | {control} | {"yes" if found.crosses else "no"} |
"""
