"""`transferkit recover`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Answer, parser


def main(arguments: Sequence[str]) -> Answer:
    """Make a whole file of a cut one."""
    flags = parser("recover", "Copy every whole chunk of a cut MCAP file into a new one.")
    flags.add_argument("file", type=Path, metavar="FILE.mcap")
    flags.add_argument("--out", type=Path, help="by default FILE.recovered.mcap")
    options = flags.parse_args(arguments)
    from transferkit.record.recover import recover  # noqa: PLC0415 - torch takes seconds to import

    out = options.out or Path(str(options.file).removesuffix(".mcap") + ".recovered.mcap")
    messages, cut = recover(options.file, out)
    text = f"{out}: {messages} messages; {options.file} was {'cut' if cut else 'whole'}"
    return Answer({"recording": str(out), "messages": messages, "cut": cut}, text)
