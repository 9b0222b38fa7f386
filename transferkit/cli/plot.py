"""`transferkit plot`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.output import print_json


def main(arguments: Sequence[str]) -> None:
    """Draw a run."""
    parser = argparse.ArgumentParser(
        "transferkit plot",
        description="Draw the learning curve of a run and how good its learnt model was, or the traces of a recorded episode.",
    )
    parser.add_argument("run", metavar="RUN|FILE.mcap", type=Path, help="run directory, finished or not, or a recording")
    parser.add_argument("--out", type=Path, help="PNG, SVG or PDF; by default RUN/curves.png or FILE.png")
    parser.add_argument("--episode", type=int, default=0, help="of a recording")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    options = parser.parse_args(arguments)
    from transferkit.pictures import draw_recording, draw_run  # noqa: PLC0415

    if options.run.is_dir():
        out = options.out or options.run / "curves.png"
        draw_run(options.run, out)
    else:
        out = options.out or options.run.with_suffix(".png")
        draw_recording(options.run, out, episode=options.episode)
    if options.json:
        print_json({"picture": str(out)})
    else:
        print(out)
