"""`transferkit record`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Answer, parser, whole
from transferkit.cli.environment import add_environment, environment
from transferkit.config.checks import EPISODES, NOT_NEGATIVE
from transferkit.files import check_new
from transferkit.table import format_table


def main(arguments: Sequence[str]) -> Answer:
    """Record episodes of a run's policy or of a core."""
    flags = parser("record", "Play a run's final policy or a core, and write what happens as an MCAP file.")
    flags.add_argument("name", metavar="RUN|CORE", help="directory of a finished run, or a core's id or folder")
    add_environment(flags, "environment to play in; a core or a run is wrapped onto another than its own")
    flags.add_argument("--member", type=whole("member", NOT_NEGATIVE), help="which of a core's source seeds, by default 0")
    flags.add_argument("--episodes", type=whole("episodes", EPISODES), default=1)
    flags.add_argument(
        "--seed", type=whole("seed", NOT_NEGATIVE), default=0, help="of the episodes' starts; 0 is the one training reports"
    )
    flags.add_argument("--out", type=Path, required=True, metavar="FILE.mcap")
    options = flags.parse_args(arguments)
    check_new(options.out, "out", ".mcap")
    from transferkit.record.play import record_episodes  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.subject import home_of, load_subject  # noqa: PLC0415

    env = environment(options, lambda: home_of(options.name))
    subject = load_subject(options.name, env=env, member=options.member)
    played = record_episodes(subject, options.out, episodes=options.episodes, seed=options.seed)
    size = options.out.stat().st_size
    rows = [{"seed": episode.seed, "steps": episode.steps, "return": episode.total} for episode in played]
    table = format_table(
        ("episode", "steps", "return"), [(k, episode.steps, f"{episode.total:.1f}") for k, episode in enumerate(played)]
    )
    hint = f"open it in Foxglove, or draw it with `transferkit plot {options.out}`"
    how = f"\n{options.name} is wrapped onto {env} and not trained there" if subject.wrapped else ""
    text = f"{table}{how}\n{options.out}: {size / 1024:.0f} KiB; {hint}"
    return Answer({"recording": str(options.out), "bytes": size, "episodes": rows}, text)
