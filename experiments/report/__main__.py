"""`python -m experiments.report runs/paper --out report.html`: a page, figures and tables of a matrix."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Parser
from transferkit.cli.endings import ended
from transferkit.cli.streams import check_readable


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, and beside it a folder `<page>_files` with figures (PNG, SVG) and tables (CSV)."""
    parser = Parser(description=__doc__)
    parser.add_argument("results", type=Path, help="folder that `experiments.matrix --out` wrote")
    parser.add_argument(
        "--out", type=Path, default=Path("report.html"), help="the page, which is replaced; by default %(default)s"
    )

    def command() -> int:
        check_readable(sys.argv[1:] if arguments is None else arguments)
        options = parser.parse_args(arguments)
        from experiments.report.write import report  # noqa: PLC0415 - takes seconds, in which a Ctrl-C may come

        report(options.results, options.out)
        return 0

    return ended(command, stopped="stopped; nothing was reported")


if __name__ == "__main__":
    sys.exit(main())
