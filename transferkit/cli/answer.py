"""What a command answers: data for `--json`, and text for everybody else."""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass

JSON_FLAG = "--json"


@dataclass(frozen=True)
class Answer:
    """The outcome of a command."""

    data: object
    """Any JSON value."""
    text: str
    code: int = 0
    """Exit status."""

    def show(self, *, as_json: bool) -> None:
        """Print the data or the text on stdout."""
        print(json.dumps(self.data, indent=2, allow_nan=False) if as_json else self.text)


def parser(command: str, description: str) -> argparse.ArgumentParser:
    """Make the parser of a command without a whole configuration; `transferkit` itself takes `--json` off its arguments."""
    epilog = f"{JSON_FLAG} prints one JSON value and nothing else on stdout."
    return argparse.ArgumentParser(f"transferkit {command}", description=description, epilog=epilog)
