"""Statistics of returns: pure functions on arrays; random ones take their generator."""

from transferkit.stats.compare import (
    Difference,
    holm_differences,
    paired_difference,
    performance_profile,
    probability_of_improvement,
    sign_flip_p,
)
from transferkit.stats.curves import area, asymptote, data_efficiency, data_efficiency_interval, jumpstart, steps_to_threshold
from transferkit.stats.intervals import (
    crossed_band,
    crossed_interval,
    hierarchical_interval,
    iqm,
    iqm_interval,
    mean_interval,
    normalized,
    stratified_interval,
    summary_interval,
)

__all__ = [
    "Difference",
    "area",
    "asymptote",
    "crossed_band",
    "crossed_interval",
    "data_efficiency",
    "data_efficiency_interval",
    "hierarchical_interval",
    "holm_differences",
    "iqm",
    "iqm_interval",
    "jumpstart",
    "mean_interval",
    "normalized",
    "paired_difference",
    "performance_profile",
    "probability_of_improvement",
    "sign_flip_p",
    "steps_to_threshold",
    "stratified_interval",
    "summary_interval",
]
