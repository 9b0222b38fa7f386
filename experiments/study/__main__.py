"""Write the tables and the figure of a study's README from its rows, or check that they say what the rows say.

`python -m experiments.study core_dyna` writes them, `python -m experiments.study --all --check` checks every study.
"""

from __future__ import annotations

import difflib
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from experiments.study.crossings import PATH, STUDY, is_current, write_crossings
from experiments.study.readme import render
from experiments.study.rooms import find, names
from transferkit.cli.answer import Parser
from transferkit.cli.endings import ended

if TYPE_CHECKING:
    from experiments.study.rooms import Study


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check; the exit status is 1 if a README differs from its rows, 2 if there is no such study."""
    parser = Parser(prog="experiments.study", description=__doc__)
    parser.add_argument("claim", nargs="*", help="a folder of experiments/studies")
    parser.add_argument("--all", action="store_true", help="every study")
    parser.add_argument("--check", action="store_true", help="change nothing; fail if a table differs from its rows")

    def command() -> int:
        options = parser.parse_args(arguments)
        if options.all == bool(options.claim):
            parser.error("name a study, or pass --all")
        studies = [find(name) for name in (names() if options.all else options.claim)]
        return max([check(study) if options.check else write(study) for study in studies])

    return ended(command, stopped="stopped; the same command goes on")


def write(study: Study) -> int:
    """Replace the tables of a README, and draw the figure of a study that keeps evaluations, or in which nothing is trained."""
    study.readme.write_text(render(study), encoding="utf-8")
    if study.curves:
        from experiments.study.figure import draw  # noqa: PLC0415 - matplotlib

        draw(study).savefig(study.folder / "figure.png", dpi=90)
    elif study.has_rows and not any(row.steps for row in study.rows):
        from experiments.study.heat_map import draw_heat_map  # noqa: PLC0415 - matplotlib

        draw_heat_map(study).savefig(study.folder / "figure.png", dpi=90)
    if study.folder.name == STUDY:
        write_crossings(study)
    return 0


def check(study: Study) -> int:
    """Print how a README differs from its rows; 1 if it does."""
    stands, computed = study.readme.read_text(encoding="utf-8"), render(study)
    name = f"{study.folder.name}/README.md"
    lines = difflib.unified_diff(stands.splitlines(), computed.splitlines(), name, f"{name}, computed", lineterm="", n=0)
    for line in lines:
        print(line)
    if study.folder.name == STUDY and not is_current(study):
        print(f"{PATH.name} of the zoo differs from the rows of {STUDY}")
        return 1
    return int(stands != computed)


if __name__ == "__main__":
    sys.exit(main())
