"""`transferkit record`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Answer, parser
from transferkit.cli.subject import add_subject, episode_rows, subject_of
from transferkit.files import check_new
from transferkit.table import format_table


def main(arguments: Sequence[str]) -> Answer:
    """Record episodes of a run's policy or of a core."""
    flags = parser("record", "Play a run's final policy or a core, and write what happens as an MCAP file.")
    add_subject(flags)
    flags.add_argument("--out", type=Path, required=True, metavar="FILE.mcap")
    options = flags.parse_args(arguments)
    check_new(options.out, "out", ".mcap")
    from transferkit.record.play import record_episodes  # noqa: PLC0415 - torch takes seconds to import

    subject = subject_of(options, values=True)
    played = record_episodes(subject, options.out, episodes=options.episodes, seed=options.seed)
    size = options.out.stat().st_size
    table = format_table(
        ("episode", "steps", "return"), [(k, episode.steps, f"{episode.total:.1f}") for k, episode in enumerate(played)]
    )
    hint = f"open it in Foxglove, or draw it with `transferkit plot {options.out}`"
    how = f"\n{options.name} is wrapped onto {subject.env} and not trained there" if subject.wrapped else ""
    text = f"{table}{how}\n{options.out}: {size / 1024:.0f} KiB; {hint}"
    return Answer({"recording": str(options.out), "bytes": size, "episodes": episode_rows(played)}, text)
