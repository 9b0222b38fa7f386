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
from transferkit.table import format_table


def main(arguments: Sequence[str]) -> None:
    """Train a policy and print its result."""
    default = preset_from(arguments)

    def command(
        config: Annotated[TrainConfig, tyro.conf.arg(name="")] = default,
        out: Path | None = None,
        resume: bool = False,
        json: bool = False,
    ) -> Callable[[], None]:
        """Train a policy around a core, or from scratch without one, and evaluate it.

        Args:
            config: the run.
            out: run directory; by default `runs/` with a name made of the configuration.
            resume: go on where the run directory stopped, to the bit.
            json: print one JSON object and nothing else on stdout.
        """
        return partial(_train, config, out, resume=resume, json=json)

    parse(command, "transferkit train", arguments)()


def _train(config: TrainConfig, out: Path | None, *, resume: bool, json: bool) -> None:
    from transferkit.transfer import run_training  # noqa: PLC0415 - seconds to import

    budget = Budget(config.episodes, config.steps, config.seconds)
    with progress(f"{config.core or 'scratch'} on {config.env}", budget) as report:
        result = run_training(config, out=out, resume=resume, report=report)
    if json:
        print_json(asdict(result))
    else:
        print(format_table(("", config.env), [(name, str(value)) for name, value in asdict(result).items()]))
