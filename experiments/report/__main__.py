"""`python -m experiments.report runs/paper --out report.html`: a page, figures and tables of a matrix."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from transferkit.errors import TransferkitError


def main() -> int:
    """Write the page, and beside it a folder `<page>_files` with figures (PNG, SVG) and tables (CSV)."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, help="folder that `experiments.matrix --out` wrote")
    parser.add_argument(
        "--out", type=Path, default=Path("report.html"), help="the page, replaced where it is; by default %(default)s"
    )
    options = parser.parse_args()
    try:
        from experiments.report.write import report  # noqa: PLC0415 - takes seconds, in which a Ctrl-C may come

        report(options.results, options.out)
    except KeyboardInterrupt:
        print("stopped; nothing was reported", file=sys.stderr)
        return 130
    except (TransferkitError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
