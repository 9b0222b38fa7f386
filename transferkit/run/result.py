"""The outcome of a training run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Result:
    """The outcome of a finished training run."""

    algo: str
    preset: str
    core: str | None
    core_digest: str | None
    member: int | None
    env: str
    seed: int
    episodes: int
    """Completed training episodes."""
    steps: int
    """Environment steps of training."""
    seconds: float
    """Seconds of training, evaluation not counted."""
    eval_return_mean: float
    eval_return_std: float
    eval_return_low: float
    """Student's 95 % interval of the mean over evaluation episodes."""
    eval_return_high: float
    eval_episodes: int
    run_dir: str
    prior_steps: int = 0
    """Steps of recordings that training started with; in no other count."""
