"""How long it takes to derive what an environment's numbers mean, over every id that is tested, and to wrap a core there."""

from __future__ import annotations

import logging
import statistics
from dataclasses import dataclass

from experiments.bench.timing import seconds
from transferkit import load_core, wrap
from transferkit.envs import derive_spec, environment_ids

SLOWEST = 5

CORE, TARGET = "walker2d-v1", "dm_control/walker-walk-v0"
"""A robot of 17 numbers on one of 24."""


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    ids: int | None
    wraps: int


FULL, TINY = Size(None, 30), Size(2, 3)


def main(size: Size) -> None:
    """Measure and print; an id is made and probed once, since a process keeps what it derived."""
    logging.disable(logging.WARNING)  # of unstable physics in random states
    try:
        derive_spec("dm_control/pendulum-swingup-v0")  # imports everything
        times = {env_id: seconds(lambda env_id=env_id: derive_spec(env_id)) for env_id in environment_ids()[: size.ids]}
    finally:
        logging.disable(logging.NOTSET)
    slowest = sorted(times, key=times.__getitem__, reverse=True)[:SLOWEST]
    print(f"deriving the spec of {len(times)} environments, making them included")
    print(f"  median {statistics.median(times.values()):.2f} s (must be 0.3)")
    print(f"  slowest {', '.join(f'{env_id} {times[env_id]:.2f} s' for env_id in slowest)} (must be 2)")
    core, _ = load_core(CORE), derive_spec(TARGET)
    wrapped = [seconds(lambda: wrap(core, TARGET)) for _ in range(size.wraps)]
    print(f"wrapping {CORE} for {TARGET}, whose spec is known: median {1000 * statistics.median(wrapped):.0f} ms (must be 50)")
