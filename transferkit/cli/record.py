"""`transferkit record`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.output import check_new, print_json
from transferkit.errors import ConfigError
from transferkit.table import format_table


def main(arguments: Sequence[str]) -> None:
    """Record episodes of a run's policy or of a core."""
    parser = argparse.ArgumentParser(
        "transferkit record", description="Play a run's final policy or a core, and write what happens as an MCAP file."
    )
    parser.add_argument("name", metavar="RUN|CORE", help="directory of a finished run, or a core's id or folder")
    parser.add_argument("--env", help="environment to play in; for a core any, onto which it is wrapped untrained")
    parser.add_argument("--member", type=int, help="which of a core's source seeds, by default 0")
    parser.add_argument("--episodes", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0, help="of the episodes' starts; 0 is the one training reports")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.mcap")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    options = parser.parse_args(arguments)
    if options.episodes < 1 or options.seed < 0:
        raise ConfigError(f"episodes={options.episodes} must be at least 1 and seed={options.seed} not negative")
    check_new(options.out, "--out")
    from transferkit.deploy import load_subject  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.record.play import record  # noqa: PLC0415

    subject = load_subject(options.name, env=options.env, member=options.member)
    played = record(subject, options.out, episodes=options.episodes, seed=options.seed)
    size = options.out.stat().st_size
    if options.json:
        rows = [{"seed": episode.seed, "steps": episode.steps, "return": episode.total} for episode in played]
        print_json({"recording": str(options.out), "bytes": size, "episodes": rows})
        return
    rows = [(k, episode.steps, f"{episode.total:.1f}") for k, episode in enumerate(played)]
    print(format_table(("episode", "steps", "return"), rows))
    print(f"{options.out}: {size / 1024:.0f} KiB; open it in Foxglove, or draw it with `transferkit plot {options.out}`")
