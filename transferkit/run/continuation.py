"""More budget for a finished run: it goes on from its final state, in the same directory and with a record of its own.

One atomic write of the run's record makes a finished run one that goes on: it then holds the new budget and what the old one
came to. A result with fewer earlier ones than the record is of before, and no longer counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from transferkit.budget import given_limits
from transferkit.errors import RunDirectoryError
from transferkit.files import damaged_run, read_json, write_json
from transferkit.reading import Count, typed
from transferkit.run.result import RECORD, RESULT, Continuation, Earlier, Record, Result
from transferkit.run.state_file import load_state
from transferkit.versions import command, git_state, versions

if TYPE_CHECKING:
    from transferkit.budget import Budget

CHECKPOINT = "checkpoint.safetensors"


@dataclass(frozen=True)
class End:
    """What a checkpoint's session says of how far it is."""

    spent: tuple[Count, Count, float]
    evaluated: Count


def finished_result(run: Path) -> Result | None:
    """Read the result of a finished run; None of one that is unfinished, or that goes on with more budget.

    Raises:
        RunDirectoryError: its record or its result is missing or damaged.
    """
    if not (run / RESULT).exists():
        return None
    result = read_json(run / RESULT, Result)
    return result if len(result.earlier) == len(read_json(run / RECORD, Record).continuations) else None


def goes_on(run: Path) -> bool:
    """Whether a run that was finished has more budget now, so that its policy is yet to come."""
    given_more = (run / RECORD).exists() and read_json(run / RECORD, Record).continuations
    return bool(given_more) and finished_result(run) is None


def recorded_limits(run: Path) -> dict[str, float]:
    """Read the limits of a run's budget, the newest if it was given more."""
    record = read_json(run / RECORD, Record)
    return record.continuations[-1].budget if record.continuations else given_limits(record.config)


def earlier_results(run: Path) -> tuple[Earlier, ...]:
    """Read what a run came to each time before it was given more budget."""
    return tuple(continuation.after for continuation in read_json(run / RECORD, Record).continuations)


def continue_run(run: Path, result: Result, budget: Budget) -> None:
    """Record that a finished run goes on with more budget.

    Raises:
        RunDirectoryError: the budget is no more than what is spent, or the run cannot go on from its end.
    """
    _check_more(run, result, budget)
    _check_good_enough(run, result)
    _check_final_state(run, result)
    after = Earlier(**{field.name: getattr(result, field.name) for field in fields(Earlier)})
    continuation = Continuation(budget.limits(), after, versions(), git_state(), command())
    record = read_json(run / RECORD, dict[str, Any])
    write_json(run / RECORD, {**record, "continuations": [*record.get("continuations", []), asdict(continuation)]})


def _check_more(run: Path, result: Result, budget: Budget) -> None:
    spent = {"episodes": result.episodes, "steps": result.steps, "seconds": result.seconds}
    own = ", ".join(f"{{{kind}={limit:g}}}" for kind, limit in recorded_limits(run).items())
    for kind, limit in budget.limits().items():
        if limit <= spent[kind]:
            raise RunDirectoryError(
                f"run {run} is finished and has spent {spent[kind]:g} {kind}, so {{{kind}={limit:g}}} is no more budget",
                remedy=f"give more {{{kind}}} to train on, or {own} for its result",
            )


def _check_good_enough(run: Path, result: Result) -> None:
    stop_at = read_json(run / RECORD, Record).config.get("stop_at")
    if isinstance(stop_at, int | float) and result.eval_return_mean >= stop_at:
        raise RunDirectoryError(
            f"run {run} has reached {{stop_at={stop_at:g}}}, which ends it under any budget",
            remedy=f"train on from it with {{core={run}}} into another {{out}}",
        )


def _check_final_state(run: Path, result: Result) -> None:
    """Compare how far the checkpoint is with the end of the run."""
    state: Mapping[str, Any] = load_state(run / CHECKPOINT) if (run / CHECKPOINT).exists() else {}
    if state:
        with damaged_run(run / CHECKPOINT):
            end = typed(state.get("session"), End)
        if (*end.spent[:2], end.evaluated) == (result.episodes, result.steps, result.steps):
            return
    raise RunDirectoryError(
        f"run {run} cannot go on with more budget: it holds no checkpoint of its end, which earlier versions did not write",
        remedy=f"train on from it with {{core={run}}} into another {{out}}",
    )
