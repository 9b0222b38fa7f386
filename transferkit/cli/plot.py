"""`transferkit plot`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.output import print_json


def main(arguments: Sequence[str]) -> None:
    """Draw a run."""
    parser = argparse.ArgumentParser(
        "transferkit plot", description="Draw the learning curve of a run, and how good its learnt model was."
    )
    parser.add_argument("run", type=Path, help="run directory, finished or not")
    parser.add_argument("--out", type=Path, help="PNG, SVG or PDF; by default curves.png in the run directory")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    options = parser.parse_args(arguments)
    from transferkit.pictures import draw_run  # noqa: PLC0415

    out = options.out or options.run / "curves.png"
    draw_run(options.run, out)
    if options.json:
        print_json({"picture": str(out)})
    else:
        print(out)
