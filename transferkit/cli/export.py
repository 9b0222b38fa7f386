"""`transferkit export`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Answer, parser
from transferkit.cli.environment import add_environment, environment
from transferkit.cli.subject import add_choice, subject_of
from transferkit.errors import ConfigError
from transferkit.files import check_new


def main(arguments: Sequence[str]) -> Answer:
    """Export a policy as ONNX, or recordings as a Minari dataset."""
    flags = parser("export", "Write a run's policy or a core as one ONNX file, or recordings as a local Minari dataset.")
    flags.add_argument("names", nargs="+", metavar="RUN|CORE|FILE.mcap", help="one policy, or recordings with --minari")
    add_environment(
        flags,
        "environment of the policy; a core or a run is wrapped onto another than its own; with --minari, the recordings' own",
    )
    add_choice(flags)
    flags.add_argument("--leapp", type=Path, metavar="FILE.yaml", help="also write LEAPP YAML and its network")
    flags.add_argument("--descriptor", type=Path, metavar="FILE.yaml", help="also write Isaac Lab's IO descriptors")
    target = flags.add_mutually_exclusive_group(required=True)
    target.add_argument("--out", type=Path, metavar="FILE.onnx")
    target.add_argument("--minari", metavar="DATASET", help="such as hopper/mine-v0")
    options = flags.parse_args(arguments)
    if (options.leapp is not None or options.descriptor is not None) and options.out is None:
        raise ConfigError("{leapp} and {descriptor} are of a policy", remedy="give {out}")
    if options.minari is not None:
        if options.member is not None or options.best or options.match is not None:
            raise ConfigError("{member}, {best} and {match} are of a policy", remedy="give {out}, or leave them out")
        return _minari(options.names, options.minari, environment(options))
    if len(options.names) > 1:
        raise ConfigError(f"{len(options.names)} policies do not fit into one file", remedy="export them one by one")
    if options.names[0].endswith(".mcap"):
        raise ConfigError(f"{options.names[0]} is a recording and not a policy", remedy="write it as a dataset with {minari}")
    check_new(options.out, "out", ".onnx")
    if options.leapp is not None:
        check_new(options.leapp, "leapp", ".yaml")
        if options.leapp.with_suffix(".onnx") == options.out:
            taken = f"{options.leapp} needs the file {options.out} for a network of its own, and {{out}} takes it"
            raise ConfigError(taken, remedy="choose another name for {leapp}")
    if options.descriptor is not None:
        if options.descriptor == options.leapp:
            raise ConfigError(f"{options.leapp} cannot be both descriptors", remedy="choose another name for {descriptor}")
        check_new(options.descriptor, "descriptor", ".yaml")
    return _onnx(options)


def _minari(names: Sequence[str], dataset: str, env: str | None) -> Answer:
    from transferkit.record.minari_export import export_minari  # noqa: PLC0415 - torch takes seconds to import

    steps = export_minari([Path(name) for name in names], dataset, env=env)
    return Answer({"dataset": dataset, "steps": steps}, f"{dataset}: {steps} steps")


def _onnx(options: argparse.Namespace) -> Answer:
    from transferkit.export import PARITY_ROWS, export_descriptor, export_leapp, export_onnx  # noqa: PLC0415 - torch takes seconds

    options.name, out = options.names[0], options.out
    subject = subject_of(options, values=False)
    network = None if options.leapp is None else export_leapp(subject, options.leapp)
    beside = "" if network is None else f"\n{options.leapp} with {network}"
    if options.descriptor is not None:
        export_descriptor(subject, options.descriptor)
        beside += f"\n{options.descriptor}"
    difference = export_onnx(subject, out)
    how = f"\n{options.name} is wrapped onto {subject.env} and not trained there" if subject.wrapped else ""
    text = f"{out}: differs from torch by at most {difference:.1e} on {PARITY_ROWS} random observations{beside}{how}"
    files = {"file": str(out)} | ({} if network is None else {"leapp": str(options.leapp), "leapp_network": str(network)})
    files |= {} if options.descriptor is None else {"descriptor": str(options.descriptor)}
    return Answer({**files, "difference": difference, "observations": PARITY_ROWS}, text)
