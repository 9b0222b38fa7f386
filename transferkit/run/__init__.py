"""The run directory: what a training run writes, so that a kill at any moment leaves it readable and resumable."""

from transferkit.run.continuation import finished_result, goes_on
from transferkit.run.directory import (
    BEST,
    CHECKPOINT,
    POLICY,
    UNTRAINED,
    RunDirectory,
    check_free,
    check_same,
    is_run,
    named_run,
    read_made_of,
    read_record,
)
from transferkit.run.result import RECORD, RESULT, Best, Earlier, MadeOf, Probation, Record, Result
from transferkit.run.session import LATEST, Report, Schedule, Scores, Session
from transferkit.run.state_file import check_alike, load_state, save_state
from transferkit.run.tables import ALWAYS, TABLES, EpisodeRow, EvaluationRow, ModelRow, Row, read_table

__all__ = [
    "ALWAYS",
    "BEST",
    "CHECKPOINT",
    "LATEST",
    "POLICY",
    "RECORD",
    "RESULT",
    "TABLES",
    "UNTRAINED",
    "Best",
    "Earlier",
    "EpisodeRow",
    "EvaluationRow",
    "MadeOf",
    "ModelRow",
    "Probation",
    "Record",
    "Report",
    "Result",
    "Row",
    "RunDirectory",
    "Schedule",
    "Scores",
    "Session",
    "check_alike",
    "check_free",
    "check_same",
    "finished_result",
    "goes_on",
    "is_run",
    "load_state",
    "named_run",
    "read_made_of",
    "read_record",
    "read_table",
    "save_state",
]
