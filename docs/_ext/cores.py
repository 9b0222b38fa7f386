"""The page of the installed cores, from their cards."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import core_zoo
from transferkit.env_id import brief
from transferkit.zoo.card import CARD, read_card
from transferkit.zoo.crossings import read_crossings
from transferkit.zoo.readme import render

if TYPE_CHECKING:
    from transferkit.zoo.card import Card
    from transferkit.zoo.crossings import Crossings

HEAD = """# The cores

Generated from the cards of the installed zoo. Scores are mean returns of deterministic actions. A
core *crosses* to an environment if every member is above every control there before any training:
doing nothing, random actions, random and shuffled cores. That says above, not well: 87 to 115 on two poles, of 9360.

| core | its environment | score | 95 % interval | threshold | members | crosses to |
|---|---|---|---|---|---|---|
"""


def page(pictures: Path) -> str:
    """Write Markdown; `pictures` holds one of each core, or of an earlier or later version of it."""
    zoo = Path(core_zoo.__path__[0])
    cards = [read_card(path.parent) for path in sorted(zoo.glob(f"*/{CARD}"))]
    crossings = read_crossings(zoo)
    rows = "".join(_row(card, crossings) for card in cards)
    return HEAD + rows + "".join(f"\n{_section(card, crossings, pictures)}" for card in cards)


def _row(card: Card, crossings: Crossings | None) -> str:
    score = card.score
    found = () if crossings is None else crossings.cores.get(card.id, ())
    cells = (
        f"[{card.id}](#{card.id})",
        brief(card.source.env_id),
        f"{score.mean:.1f}",
        f"{score.low:.1f} to {score.high:.1f}",
        f"{score.threshold:g}",
        str(len(card.seeds)),
        str(sum(one.crosses for one in found)),
    )
    return f"| {' | '.join(cells)} |\n"


def _section(card: Card, crossings: Crossings | None, pictures: Path) -> str:
    title, _, text = render(card, crossings).partition("\n")
    base = re.sub(r"-v\d+$", "", card.id)
    picture = max(pictures.glob(f"{base}-v[0-9].png"), default=None)
    shown = "" if picture is None else f"\n![{base} on its own robot](images/{pictures.name}/{picture.name})\n"
    return f"#{title}\n{shown}{text}"
