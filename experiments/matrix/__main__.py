"""Run a grid: `python -m experiments.matrix experiments/studies/core_dyna/grid.toml --out runs/core_dyna [--dry-run]`.

Every run is a folder `cells/<hash of what determines it>` with a run directory in it. The same command goes on after any
interruption; folders of several machines are merged by copying them into one `cells`. `cells.csv` holds one row for every run
that ended, `evaluations.csv` one for each of their evaluations.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

from transferkit.cli.answer import Parser, whole
from transferkit.cli.endings import ended
from transferkit.cli.streams import check_readable
from transferkit.config.checks import AT_LEAST_ONE


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is not done; the exit status is 1 if a cell failed, 2 if the grid or the cluster is wrong."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("grid", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=whole("workers", AT_LEAST_ONE), default=2, help="processes on this machine")
    where.add_argument("--ray", metavar="ADDRESS", help="run on a Ray cluster instead: `auto`, HOST:PORT or ray://HOST:PORT")
    parser.add_argument("--env", action="append", default=[], metavar="MODULE:ID", help="a target whose module may be run")
    parser.add_argument("--resume", action="store_true", help="the default: what is done is never run again")
    parser.add_argument("--dry-run", action="store_true", help="print the plan and run nothing")

    def command() -> int:
        check_readable(sys.argv[1:] if arguments is None else arguments)
        options = parser.parse_args(arguments)
        from experiments.matrix.runner import run  # noqa: PLC0415 - takes seconds, in which a Ctrl-C may come

        return run(
            options.grid, options.out, workers=options.workers, ray=options.ray, dry_run=options.dry_run, named=options.env
        )

    try:
        return ended(command, stopped="stopped; the same command goes on")
    except BrokenProcessPool:
        print("a worker died, perhaps of too little memory; the same command goes on", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
