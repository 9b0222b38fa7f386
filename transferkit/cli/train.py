"""`transferkit train`."""

from __future__ import annotations

import logging
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import tyro

from transferkit.budget import Budget
from transferkit.cli.answer import Answer
from transferkit.cli.environment import gathered, with_arguments
from transferkit.cli.flags import defaults, parse, settings_in
from transferkit.config import TrainConfig, check_read, with_settings
from transferkit.errors import ConfigError, SettingError
from transferkit.table import format_table

LOGGER = logging.getLogger("transferkit")


@dataclass(frozen=True)
class _Request:
    config: TrainConfig
    out: Path | None
    resume: bool
    record_every: int


def main(arguments: Sequence[str]) -> Answer:
    """Train a policy; answers with its result."""
    arguments = gathered(arguments)
    default, given = defaults(arguments), settings_in(arguments)

    def command(
        config: Annotated[TrainConfig, tyro.conf.arg(name="")] = default,
        out: Path | None = None,
        resume: bool = False,
        record: str | None = None,
        trust_core: bool = False,
        env_kwargs: tuple[str, ...] = (),
        vary: tuple[str, ...] = (),
    ) -> _Request:
        """Train a policy around a core, or from scratch without one, and evaluate it.

        Args:
            config: the run.
            out: run directory; by default `runs/` with a name made of the configuration.
            resume: go on where the run directory stopped, to the bit; a finished run goes on if its budget is larger now.
            record: `every=N` records an episode of every Nth evaluation as MCAP in the run directory.
            trust_core: train the core even if it is no better than doing nothing, and do not ask (`--wrap.probation 0`).
            env_kwargs: NAME=VALUE keyword arguments of the environment; `--env 'ENV?NAME=VALUE'` is the same.
            vary: NAME=VALUE changes of the robot, such as mass=1.3 friction=0.5..1.5; a range is drawn every episode.
        """
        if trust_core:
            config = _trusting(config, given)
        return _Request(replace(config, env=with_arguments(config.env, env_kwargs, vary)), out, resume, _every(record))

    request = parse(command, "transferkit train", arguments, ("out", "resume", "record", "trust-core", "env-kwargs", "vary"))
    check_read(request.config, given)
    return _train(request)


def _trusting(config: TrainConfig, given: Collection[str]) -> TrainConfig:
    if config.core is None:
        raise ConfigError("{trust_core} has no effect without a core", remedy="leave it out, or give {core}")
    if "wrap.probation" in given and config.wrap.probation:
        raise ConfigError(
            f"{{trust_core}} is {{wrap.probation=0}}, not {config.wrap.probation}", remedy="leave one of them out"
        )
    return with_settings(config, {"wrap.probation": 0})


def _every(record: str | None) -> int:
    if record is None:
        return 0
    if not re.fullmatch(r"every=0*[1-9][0-9]{0,17}", record):
        raise SettingError("record", value=record, allowed="every=N with a whole number above 0")
    return int(record.removeprefix("every="))


def _train(request: _Request) -> Answer:
    from transferkit.cli.progress import progress  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.run import is_run  # noqa: PLC0415
    from transferkit.training import default_directory, run_training  # noqa: PLC0415

    config = request.config
    out = request.out or default_directory(config)
    if request.resume and not is_run(out):
        LOGGER.warning("%s has no run to go on with: one starts there", out)
    with progress(
        f"{config.core or 'scratch'} on {config.env}", Budget(config.episodes, config.steps, config.seconds)
    ) as report:
        result = asdict(run_training(config, out=out, resume=request.resume, report=report, record_every=request.record_every))
    return Answer(result, format_table(("", config.env), _rows(result)))


def _short(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _rows(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The fields of a result; what the run came to before it was given more budget as a row each."""
    told = {
        "best": "return {return_mean:.6g} after {steps} steps",
        "probation": "{decided}: {reason}; {episodes} episodes, {steps} steps",
    }
    decided = "trusted" if (result["probation"] or {}).get("accepted") else "refused"
    rows = [
        (name, told[name].format(**value, decided=decided) if name in told else _short(value))
        for name, value in result.items()
        if name != "earlier" and value is not None
    ]
    text = "return {eval_return_mean} after {episodes} episodes, {steps} steps, {seconds} seconds"
    return rows + [(f"before budget {k}", text.format(**before)) for k, before in enumerate(result["earlier"], 2)]
