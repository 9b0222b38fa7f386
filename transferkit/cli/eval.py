"""`transferkit eval`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.output import print_json


def main(arguments: Sequence[str]) -> None:
    """Evaluate the final policy of a run."""
    parser = argparse.ArgumentParser("transferkit eval", description="Play the final policy of a run deterministically.")
    parser.add_argument("run", metavar="RUN", type=Path, help="directory of a finished training run")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0, help="of the episodes' starts; 0 is the one training reports")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    options = parser.parse_args(arguments)
    from transferkit.trained import evaluate_run  # noqa: PLC0415 - torch takes seconds to import

    row = evaluate_run(options.run, episodes=options.episodes, seed=options.seed).row()
    if options.json:
        print_json({"run_dir": str(options.run), "seed": options.seed, **row})
        return
    interval = f"95 % interval {row['return_low']:.1f} to {row['return_high']:.1f}"
    print(f"return {row['return_mean']:.1f}, {interval}, {row['n']} episodes, seed {options.seed}")
