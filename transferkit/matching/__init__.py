"""What of a target means what a core's numbers mean: which joint is which, and how to compute one from the other."""

from transferkit.matching.align import distance
from transferkit.matching.earlier import earlier_match
from transferkit.matching.explain import coverage, explain
from transferkit.matching.files import as_plain, check_match, load_match, save_match
from transferkit.matching.limits import Limit, Unlike, limits, mean_reach, reach, unlike
from transferkit.matching.make import find_pairing, match_for
from transferkit.matching.match import Match, angle_pairs, compiled, padded
from transferkit.matching.pair import pair
from transferkit.matching.unmatched import Unmatched, unmatched
from transferkit.pairing import Angles, Copy, Forces, Limbs, Pairing

__all__ = [
    "Angles",
    "Copy",
    "Forces",
    "Limbs",
    "Limit",
    "Match",
    "Pairing",
    "Unlike",
    "Unmatched",
    "angle_pairs",
    "as_plain",
    "check_match",
    "compiled",
    "coverage",
    "distance",
    "earlier_match",
    "explain",
    "find_pairing",
    "limits",
    "load_match",
    "match_for",
    "mean_reach",
    "padded",
    "pair",
    "reach",
    "save_match",
    "unlike",
    "unmatched",
]
