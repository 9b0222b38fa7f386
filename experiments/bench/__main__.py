"""Measure speed: `python -m experiments.bench ppo` runs one bench, without a name all of them, each in its own process.

Run it with nothing beside it. The machine's speed drifts, so only ratios of neighbours within one run count.
"""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
import warnings
from collections.abc import Sequence

BENCHES = {
    "ppo": "PPO against stable-baselines3, and start-up times",
    "dyna": "DYNA-DDPG's updates and steps against stable-baselines3, SBX and their matrix products alone",
    "model": "the learnt model against mbrl-lib",
    "record": "recording against evaluation, and reading back",
    "probe": "deriving what the numbers of every environment mean, and wrapping a core",
    "report": "the report of 1,000 runs",
    "matrix": "a matrix on one worker and on two",
    "paper": "the paper presets, and the default presets against the paper's best scores",
}

TRIALS = {
    "faults": "damaged and forged files of every format are refused in one line",
    "kills": "jobs that are killed again and again go on to the same bits",
    "full-disk": "commands whose disk is full say so and go on",
}
"""Not measured, and not part of all benches: `python -m experiments.bench kills --help` explains each."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one bench here, or all of them one after the other."""
    given = [*(sys.argv[1:] if arguments is None else arguments)]
    os.environ["OMP_NUM_THREADS"] = "1"  # before torch is imported
    if given and given[0] in TRIALS:
        return importlib.import_module(f"experiments.bench.{given[0].replace('-', '_')}.campaign").command(given[1:])
    lines = "\n".join(f"  {name:9} {what}" for name, what in (BENCHES | TRIALS).items())
    formatter = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(prog="experiments.bench", description=f"{__doc__}\n{lines}", formatter_class=formatter)
    parser.add_argument("name", nargs="?", choices=[*BENCHES])
    parser.add_argument("--tiny", action="store_true", help="as little as possible: shows that it runs, measures nothing")
    options = parser.parse_args(given)
    if options.name is None:
        more = ["--tiny"] if options.tiny else []
        return max(subprocess.call([sys.executable, "-m", "experiments.bench", name, *more]) for name in BENCHES)
    warnings.simplefilter("ignore")
    bench = importlib.import_module(f"experiments.bench.{options.name}")
    bench.main(bench.TINY if options.tiny else bench.FULL)
    return 0


if __name__ == "__main__":
    sys.exit(main())
