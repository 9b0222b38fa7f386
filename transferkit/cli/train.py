"""`transferkit train`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated

import tyro

from transferkit.budget import Budget
from transferkit.cli.flags import parse, preset_from
from transferkit.cli.output import print_json, progress
from transferkit.config import TrainConfig
from transferkit.errors import ConfigError
from transferkit.table import format_table


def main(arguments: Sequence[str]) -> None:
    """Train a policy and print its result."""
    default = preset_from(arguments)

    def command(
        config: Annotated[TrainConfig, tyro.conf.arg(name="")] = default,
        out: Path | None = None,
        resume: bool = False,
        record: str | None = None,
        json: bool = False,
    ) -> Callable[[], None]:
        """Train a policy around a core, or from scratch without one, and evaluate it.

        Args:
            config: the run.
            out: run directory; by default `runs/` with a name made of the configuration.
            resume: go on where the run directory stopped, to the bit.
            record: `every=N` records an episode of every Nth evaluation as MCAP in the run directory.
            json: print one JSON object and nothing else on stdout.
        """
        return partial(_train, config, out, resume=resume, record_every=_every(record), json=json)

    parse(command, "transferkit train", arguments)()


def _every(record: str | None) -> int:
    if record is None:
        return 0
    name, _, number = record.partition("=")
    if name != "every" or not number.isdigit() or not int(number):
        raise ConfigError(f"record={record!r} must be every=N with a whole number above 0; pass --record every=1")
    return int(number)


def _train(config: TrainConfig, out: Path | None, *, resume: bool, record_every: int, json: bool) -> None:
    from transferkit.transfer import run_training  # noqa: PLC0415 - seconds to import

    budget = Budget(config.episodes, config.steps, config.seconds)
    with progress(f"{config.core or 'scratch'} on {config.env}", budget) as report:
        result = run_training(config, out=out, resume=resume, report=report, record_every=record_every)
    if json:
        print_json(asdict(result))
    else:
        print(format_table(("", config.env), [(name, str(value)) for name, value in asdict(result).items()]))
