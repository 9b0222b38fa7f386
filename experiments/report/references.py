"""What a normalised score of 1 is on every target; 0 is the target's zero action."""

from __future__ import annotations

from transferkit.env_id import EnvId

DM_CONTROL = 1000.0
"""The most a suite task can give: 1 for each of 1000 steps (Tassa et al. 2018)."""

BEST = {
    "InvertedPendulum-v5": (1000.0, "the task's maximum"),  # 1 for each of 1000 steps
    "InvertedDoublePendulum-v5": (9360.0, "the task's maximum"),  # upright and still for 1000 steps
    "Hopper-v5": (3500.0, "about what converged training reaches, Haarnoja et al. 2018"),
}

AT_LEAST = {
    "HalfCheetah-v5": (4800.0, "Gymnasium's reward_threshold"),
    "Walker2d-v5": (4100.0, "what PPO reaches here in a million steps, study ppo_long"),
}
"""What counts unless a run is better."""


def best(target: str, seen: float) -> tuple[float, str]:
    """The upper reference and where it comes from, for a changed robot of the one that was changed.

    The best run seen if nothing is known.
    """
    env = EnvId.read(target).id
    if env.startswith("dm_control/"):
        return DM_CONTROL, "the suite's maximum"
    if env in BEST:
        return BEST[env]
    if env in AT_LEAST and AT_LEAST[env][0] >= seen:
        return AT_LEAST[env]
    return seen, "the best run in this matrix"
