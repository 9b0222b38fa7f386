"""`transferkit quickstart`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from transferkit.cli.output import print_json, progress
from transferkit.table import format_table


def main(arguments: Sequence[str]) -> None:
    """Run the main job and print its tables."""
    parser = argparse.ArgumentParser(
        "transferkit quickstart",
        description="Play the inverted-pendulum core on dm_control's cart-pole without training; then train it on "
        "InvertedDoublePendulum-v5 for 200 episodes, beside the same budget from scratch.",
    )
    parser.add_argument("--out", type=Path, default=Path("runs/quickstart"), help="folder of the runs and the picture")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    options = parser.parse_args(arguments)
    from transferkit.quickstart import CORE, EPISODES, TARGET, TWIN, TWIN_EPISODES, quickstart  # noqa: PLC0415

    outcome = quickstart(options.out, progress, seed=options.seed)
    if options.json:
        print_json(asdict(outcome))
        return
    print(f"1. {CORE} on its twin {TWIN}, before any target step ({TWIN_EPISODES} episodes a policy)\n")
    rows = [
        (z.who, f"{z.mean:.0f}", f"{z.low:.0f} to {z.high:.0f}", " ".join(f"{m:.0f}" for m in z.members)) for z in outcome.twin
    ]
    print(format_table(("policy", "return", "95 % interval", "each member"), rows))
    print(f"\n2. {TARGET}, {EPISODES} episodes of training, seed {options.seed}\n")
    trained = [
        (
            run.core or "scratch",
            run.episodes,
            run.steps,
            f"{run.seconds:.1f}",
            f"{run.eval_return_mean:.1f}",
            f"{run.eval_return_low:.1f} to {run.eval_return_high:.1f}",
        )
        for run in outcome.runs
    ]
    nothing = outcome.zero_action
    trained.append(("zero action", 0, 0, "0.0", f"{nothing.mean:.1f}", f"{nothing.low:.1f} to {nothing.high:.1f}"))
    header = ("policy", "episodes", "env steps", "seconds", "return", "95 % interval")
    print(format_table(header, trained))
    print(f"\nlearning curves: {outcome.picture}")
    print("One seed shows how it works, not whether the core helps: that takes many seeds and controls.")
