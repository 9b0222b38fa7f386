"""`transferkit train`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import tyro

from transferkit.budget import Budget
from transferkit.cli.output import print_json, progress
from transferkit.config import PPO_PRESETS, TrainConfig, preset
from transferkit.errors import ConfigError
from transferkit.table import format_table

Flat = tyro.conf.OmitArgPrefixes


def main(arguments: Sequence[str]) -> None:
    """Train a policy and print its result."""
    default = preset_from(arguments)

    def command(
        config: Annotated[TrainConfig, tyro.conf.arg(name="")] = default,
        out: Path | None = None,
        resume: bool = False,
        json: bool = False,
    ) -> None:
        """Train a policy around a core, or from scratch without one, and evaluate it.

        Args:
            config: the run.
            out: run directory; by default `runs/` with a name made of the configuration.
            resume: go on where the run directory stopped, to the bit.
            json: print one JSON object and nothing else on stdout.
        """
        from transferkit.transfer import run_training  # noqa: PLC0415 - seconds to import

        budget = Budget(config.episodes, config.steps, config.seconds)
        with progress(f"{config.core or 'scratch'} on {config.env}", budget) as report:
            result = run_training(config, out=out, resume=resume, report=report)
        if json:
            print_json(asdict(result))
        else:
            print(format_table(("", config.env), [(name, str(value)) for name, value in asdict(result).items()]))

    tyro.cli(command, prog="transferkit train", args=list(arguments))


def preset_from(arguments: Sequence[str]) -> TrainConfig:
    """The defaults that the other flags override: those of `--preset`."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--preset", default="default")
    name = parser.parse_known_args(list(arguments))[0].preset
    if name not in PPO_PRESETS:
        raise ConfigError(f"unknown preset '{name}'; --preset takes {' or '.join(PPO_PRESETS)}")
    return preset(TrainConfig(env=tyro.MISSING), name)
