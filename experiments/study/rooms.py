"""Studies as folders: each has a grid, the rows of its runs, and a README that reports them."""

from __future__ import annotations

import csv
import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.matrix.table import read_rows
from experiments.report.comparisons import compare
from transferkit import stats
from transferkit.errors import TransferkitError

if TYPE_CHECKING:
    from experiments.matrix.table import Row
    from experiments.report.comparisons import Group

STUDIES = Path(__file__).parents[1] / "studies"


class StudyError(TransferkitError):
    """A study that does not exist, or a table in its README that cannot be computed."""


@dataclass(frozen=True)
class Study:
    """One claim's folder."""

    folder: Path

    @property
    def readme(self) -> Path:
        """The page."""
        return self.folder / "README.md"

    @property
    def has_rows(self) -> bool:
        """Whether it is about runs of a matrix."""
        return (self.folder / "rows.csv").exists()

    @functools.cached_property
    def rows(self) -> list[Row]:
        """Every run that ended."""
        return [self._measured(row) for row in read_rows(self.folder / "rows.csv")]

    @functools.cached_property
    def groups(self) -> list[Group]:
        """Its comparisons, as a report judges them."""
        return compare(self.rows)

    @functools.cached_property
    def curves(self) -> Mapping[str, Sequence[Mapping[str, float]]]:
        """Evaluations during training, by the id of the run; empty if the study keeps none."""
        found: dict[str, list[dict[str, float]]] = {}
        for line in self.lines("curves"):
            found.setdefault(line.pop("id"), []).append({name: float(value) for name, value in line.items()})
        return found

    def _measured(self, row: Row) -> Row:
        """The run with the area under its curve, which earlier tables do not have."""
        points = self.curves.get(row.id, ())
        if len(points) < 2 or not math.isnan(row.area):
            return row
        steps, returns = ([point[name] for point in points] for name in ("steps", "return_mean"))
        return replace(row, area=stats.area(steps, returns), first_return_mean=returns[0])

    def lines(self, name: str) -> list[dict[str, str]]:
        """Another table of the folder, as text; empty if there is none."""
        path = self.folder / f"{name}.csv"
        if not path.exists():
            return []
        with path.open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file))


def find(name: str) -> Study:
    """The study of a name.

    Raises:
        StudyError: there is none.
    """
    known = names()
    if name not in known:
        raise StudyError(f"no study {name!r}; there are {', '.join(known)}")
    return Study(STUDIES / name)


def names() -> list[str]:
    """Every study."""
    return sorted(path.parent.name for path in STUDIES.glob("*/README.md"))
