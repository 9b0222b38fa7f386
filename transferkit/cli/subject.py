"""What the commands share that play a run's policy or a core."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from transferkit.cli.answer import whole
from transferkit.cli.environment import add_environment, environment
from transferkit.config.checks import EPISODES, NOT_NEGATIVE

if TYPE_CHECKING:
    from transferkit.record.play import Played, Subject


def add_subject(flags: argparse.ArgumentParser, *, episodes: int = 1) -> None:
    """Add what is played, where, and from which starts."""
    flags.add_argument("name", metavar="RUN|CORE", help="directory of a finished run, or a core's id or folder")
    add_environment(flags, "environment to play in; a core or a run is wrapped onto another than its own")
    add_choice(flags)
    flags.add_argument("--episodes", type=whole("episodes", EPISODES), default=episodes)
    flags.add_argument(
        "--seed", type=whole("seed", NOT_NEGATIVE), default=0, help="of the episodes' starts; 0 is the one training reports"
    )


def add_choice(flags: argparse.ArgumentParser) -> None:
    """Add which policy of a core or of a run is meant, and how it stands on another environment."""
    flags.add_argument("--member", type=whole("member", NOT_NEGATIVE), help="which of a core's source seeds, by default 0")
    flags.add_argument("--match", type=Path, metavar="FILE", help="how it stands on another robot, from `transferkit match`")
    flags.add_argument("--best", action="store_true", help="of a run, the policy that its evaluations found best")


def subject_of(options: argparse.Namespace, *, values: bool) -> Subject:
    """Load what the flags say."""
    from transferkit.subject import home_of, load_subject  # noqa: PLC0415 - torch takes seconds to import

    name, env = options.name, environment(options, lambda: home_of(options.name))
    return load_subject(name, env=env, member=options.member, best=options.best, match=options.match, values=values)


def episode_rows(episodes: Sequence[Played]) -> list[dict[str, Any]]:
    """Episodes as JSON-ready rows."""
    return [{"seed": episode.seed, "steps": episode.steps, "return": episode.total} for episode in episodes]
