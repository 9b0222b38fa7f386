"""`transferkit export`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.output import check_new, print_json
from transferkit.errors import ConfigError


def main(arguments: Sequence[str]) -> None:
    """Export a policy as ONNX, or recordings as a Minari dataset."""
    parser = argparse.ArgumentParser(
        "transferkit export",
        description="Write a run's policy or a core as one ONNX file, or recordings as a local Minari dataset.",
    )
    parser.add_argument("names", nargs="+", metavar="RUN|CORE|FILE.mcap", help="one policy, or recordings with --minari")
    parser.add_argument("--env", help="wrap a core onto this environment, untrained")
    parser.add_argument("--member", type=int, help="which of a core's source seeds, by default 0")
    target = parser.add_mutually_exclusive_group(required=True)
    target.add_argument("--out", type=Path, metavar="FILE.onnx")
    target.add_argument("--minari", metavar="DATASET", help="such as hopper/mine-v0")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    options = parser.parse_args(arguments)
    if options.minari:
        from transferkit.record.datasets import export_minari  # noqa: PLC0415

        steps = export_minari([Path(name) for name in options.names], options.minari)
        _say(options, {"dataset": options.minari, "steps": steps}, f"{options.minari}: {steps} steps")
        return
    if len(options.names) > 1:
        raise ConfigError(f"{len(options.names)} policies do not fit into one file; export them one by one")
    check_new(options.out, "--out")
    from transferkit.deploy import PARITY_ROWS, export_onnx, load_subject  # noqa: PLC0415 - torch takes seconds to import

    difference = export_onnx(load_subject(options.names[0], env=options.env, member=options.member, values=False), options.out)
    text = f"{options.out}: differs from torch by at most {difference:.1e} on {PARITY_ROWS} random observations"
    _say(options, {"file": str(options.out), "difference": difference, "observations": PARITY_ROWS}, text)


def _say(options: argparse.Namespace, data: dict[str, object], text: str) -> None:
    if options.json:
        print_json(data)
    else:
        print(text)
