"""What every environment can represent of every core: the pairs whose untrained play is worth a table.

`python -m experiments.matches --out matches.csv` writes a line for each core and environment of which anything is matched.
"""

from __future__ import annotations

import csv
import sys
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.cli.answer import Parser
from transferkit.cli.endings import ended
from transferkit.envs import environment_ids
from transferkit.files import check_new, new_file
from transferkit.zoo.find import Found, find_cores

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Match and write; the exit status is 2 if an argument is wrong."""
    parser = Parser(prog="experiments.matches", description=__doc__)
    parser.add_argument("--env", action="append", help="id; may be given several times; by default every environment")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.csv")
    return ended(lambda: run(parser.parse_args(arguments)), stopped="stopped; nothing was written")


def run(options: argparse.Namespace) -> int:
    """Check the options, and write; 0."""
    check_new(options.out, "out", ".csv")
    write(options.env or environment_ids(), options.out)
    return 0


def write(envs: Sequence[str], path: Path) -> None:
    """Write the pairs of these environments with the zoo's cores, environment by environment."""
    with new_file(path, "out") as temporary, temporary.open("w", newline="") as file:
        table = csv.DictWriter(file, ["target", *(field.name for field in fields(Found))])
        table.writeheader()
        for k, env in enumerate(envs, 1):
            found, _ = find_cores(env)
            table.writerows({"target": env, **asdict(one)} for one in found)
            print(f"{k} of {len(envs)}: {env}, {len(found)} cores", flush=True)


if __name__ == "__main__":
    sys.exit(main())
