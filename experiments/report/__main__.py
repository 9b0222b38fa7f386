"""`python -m experiments.report runs/paper --out report.html`: a page, figures and tables of a matrix."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Parser
from transferkit.cli.streams import check_readable, drop_output, mend_surroundings
from transferkit.cli.wording import worded
from transferkit.errors import TransferkitError


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the page, and beside it a folder `<page>_files` with figures (PNG, SVG) and tables (CSV)."""
    parser = Parser(description=__doc__)
    parser.add_argument("results", type=Path, help="folder that `experiments.matrix --out` wrote")
    parser.add_argument(
        "--out", type=Path, default=Path("report.html"), help="the page, which is replaced; by default %(default)s"
    )
    mend_surroundings()
    try:
        check_readable(sys.argv[1:] if arguments is None else arguments)
        options = parser.parse_args(arguments)
        from experiments.report.write import report  # noqa: PLC0415 - takes seconds, in which a Ctrl-C may come

        report(options.results, options.out)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("stopped; nothing was reported", file=sys.stderr)
        return 130
    except (TransferkitError, OSError) as error:
        with contextlib.suppress(OSError):
            print(f"error: {worded(error)}", file=sys.stderr)
        return drop_output(2)
    return 0


if __name__ == "__main__":
    sys.exit(main())
