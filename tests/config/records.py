"""Records of runs as version 0.1 wrote them."""

import json
from pathlib import Path

FOLDER = Path(__file__).parent / "records_0_1"


def old_record(preset, **changes):
    """The configuration of a run of a preset; `changes` are other values, `ppo`, `dyna` and `wrap` in part."""
    record = json.loads((FOLDER / f"{preset}.json").read_text())
    return record | {name: {**record[name], **new} if isinstance(new, dict) else new for name, new in changes.items()}
