"""A core in one line, for lists and for the index of a zoo elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from transferkit.reading import Count, Size

if TYPE_CHECKING:
    from transferkit.zoo.card import Card


@dataclass(frozen=True)
class Summary:
    """What a list says about a core."""

    source_env: str
    obs_dim: Size
    act_dim: Size
    parts: tuple[str, ...]
    """Its components."""
    members: Count
    score_mean: float
    score_low: float
    score_high: float
    threshold: float

    @staticmethod
    def of(card: Card) -> Summary:
        """Sum up a card."""
        source, score = card.source, card.score
        shape = source.env_id, source.obs_dim, source.act_dim, tuple(card.components), len(card.seeds)
        return Summary(*shape, score.mean, score.low, score.high, score.threshold)
