"""What is said of an environment that breaks."""

from __future__ import annotations

import traceback
from pathlib import Path

from transferkit.errors import EnvironmentContractError


def failed(env: str, where: str, error: BaseException) -> EnvironmentContractError:
    """The one line about an exception in somebody else's code."""
    frame = traceback.extract_tb(error.__traceback__)[-1]
    try:
        words = str(error)
    except Exception:  # of an error of the environment's own
        words = "no reason that can be written"
    reason = " ".join(f"{type(error).__name__}: {words}".split())[:300]
    place = f"{Path(frame.filename).name}, line {frame.lineno}"
    return EnvironmentContractError(f"environment {env} failed in {where} with {reason} ({place})", topic="own environments")
