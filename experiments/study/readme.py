"""Tables in a README, each between comments that say what it holds.

The opening comment begins with the word `table`; its further lines are TOML: a `kind` (see `experiments.study.kinds`) and that
kind's options. The table ends with a comment `end`.
"""

from __future__ import annotations

import re
import tomllib
from typing import TYPE_CHECKING

from experiments.study.kinds import KINDS
from experiments.study.rooms import StudyError

if TYPE_CHECKING:
    from experiments.study.kinds import Lines
    from experiments.study.rooms import Study

TABLE = re.compile(r"(<!-- table\n(?P<spec>.*?)-->\n)(?P<body>.*?)(<!-- end -->)", re.DOTALL)


def render(study: Study) -> str:
    """The text of a study's README with every table computed from its rows.

    Raises:
        StudyError: a table's description is wrong.
    """
    text = study.readme.read_text(encoding="utf-8")
    return TABLE.sub(lambda found: found[1] + _markdown(_compute(study, found["spec"])) + found[4], text)


def _compute(study: Study, spec: str) -> Lines:
    try:
        options = tomllib.loads(spec)
        return KINDS[options.pop("kind")](study, **options)
    except (LookupError, AttributeError, AssertionError, TypeError, ValueError) as error:
        raise StudyError(f"{study.readme}: the table of {spec.splitlines()[:1]} cannot be made ({error!r})") from error


def _cell(text: str) -> str:
    """A cell on one line; what is in code is left to its author."""
    return " ".join(text.replace("|", r"\|").splitlines())


def _markdown(lines: Lines) -> str:
    rows = [f"| {' | '.join(map(_cell, line))} |\n" for line in lines]
    return "".join([rows[0], "|" + "---|" * len(lines[0]) + "\n", *rows[1:]])
