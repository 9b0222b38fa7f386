"""The run directory: what a training run writes, so that a kill at any moment leaves it readable and resumable."""

from transferkit.run.directory import CHECKPOINT, POLICY, RECORD, RESULT, RunDirectory, check_same, read_record
from transferkit.run.result import Result
from transferkit.run.session import Report, Schedule, Scores, Session
from transferkit.run.state_file import check_state, load_state, save_state
from transferkit.run.tables import ALWAYS, TABLES, EpisodeRow, EvaluationRow, ModelRow, Row, read_table

__all__ = [
    "ALWAYS",
    "CHECKPOINT",
    "POLICY",
    "RECORD",
    "RESULT",
    "TABLES",
    "EpisodeRow",
    "EvaluationRow",
    "ModelRow",
    "Report",
    "Result",
    "Row",
    "RunDirectory",
    "Schedule",
    "Scores",
    "Session",
    "check_same",
    "check_state",
    "load_state",
    "read_record",
    "read_table",
    "save_state",
]
