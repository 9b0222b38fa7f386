"""`transferkit recover`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.output import check_new, print_json


def main(arguments: Sequence[str]) -> None:
    """Make a whole file of a cut one."""
    parser = argparse.ArgumentParser(
        "transferkit recover", description="Copy every whole chunk of a cut MCAP file into a new one."
    )
    parser.add_argument("file", type=Path, metavar="FILE.mcap")
    parser.add_argument("--out", type=Path, help="by default FILE.recovered.mcap")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    options = parser.parse_args(arguments)
    from transferkit.record.recover import recover  # noqa: PLC0415

    out = options.out or options.file.with_suffix(".recovered.mcap")
    check_new(out, "--out")
    messages, cut = recover(options.file, out)
    if options.json:
        print_json({"recording": str(out), "messages": messages, "cut": cut})
    else:
        print(f"{out}: {messages} messages; {options.file} was {'cut' if cut else 'whole'}")
