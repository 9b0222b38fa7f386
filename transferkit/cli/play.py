"""`transferkit play`."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.cli.answer import Answer, parser, whole
from transferkit.cli.subject import add_subject, episode_rows, subject_of
from transferkit.errors import ConfigError
from transferkit.files import check_new
from transferkit.play.limits import SECONDS, SECONDS_ALLOWED, STRIP, VIDEO
from transferkit.renderer import choose_renderer, no_window

if TYPE_CHECKING:
    from transferkit.play.episodes import Shown
    from transferkit.record.play import Subject

LONGEST_NAME = 100
"""Characters of a file's name that are taken from the policy and its environment."""


def main(arguments: Sequence[str]) -> Answer:
    """Show a run's policy or a core."""
    flags = parser(
        "play",
        "Play a run's final policy or a core and show it: in MuJoCo's viewer, in real time, or without a display in a file.",
    )
    add_subject(flags)
    flags.add_argument("--out", type=Path, metavar="FILE.mp4|FILE.png", help="a video, or a strip of pictures of one episode")
    flags.add_argument(
        "--seconds", type=whole("seconds", SECONDS_ALLOWED), help=f"simulated time in a file at most, by default {SECONDS}"
    )
    flags.add_argument("--inputs", action="store_true", help="show what enters the core, too")
    options = flags.parse_args(arguments)
    if options.out is not None:
        check_new(options.out, "out", VIDEO, STRIP)
    why = "" if options.out is not None else no_window()
    return _in_a_file(options, why) if options.out is not None or why else _in_a_window(options)


def _in_a_window(options: argparse.Namespace) -> Answer:
    if options.seconds is not None:
        raise ConfigError("{seconds} is of a file, and the viewer shows whole episodes", remedy="give {out}, or leave it out")
    subject = subject_of(options, values=False)
    return _answer(options, subject, _played(options, subject, None), "shown in MuJoCo's viewer", None)


def _in_a_file(options: argparse.Namespace, why: str) -> Answer:
    choose_renderer()  # before mujoco is imported: PyOpenGL stays with what it was first loaded for
    subject = subject_of(options, values=False)
    out = options.out or Path(_file_name(options.name, options.member, str(subject.env)))
    check_new(out, "out", VIDEO, STRIP)
    shown = _played(options, subject, out)
    return _answer(options, subject, shown, f"{why}: wrote {out}" if why else f"wrote {out}", out)


def _played(options: argparse.Namespace, subject: Subject, out: Path | None) -> Shown:
    from transferkit.play.episodes import play_episodes  # noqa: PLC0415

    return play_episodes(
        subject, out, episodes=options.episodes, seed=options.seed, seconds=options.seconds or SECONDS, inputs=options.inputs
    )


def _file_name(name: str, member: int | None, env: str) -> str:
    """Name a video after a policy and its environment."""
    words = [Path(name).resolve().name, *([] if member is None else [str(member)]), env]
    return "_".join(re.sub(r"[^\w.]+", "-", word).strip("-.") for word in words)[:LONGEST_NAME] + VIDEO


def _answer(options: argparse.Namespace, subject: Subject, shown: Shown, what: str, out: Path | None) -> Answer:
    steps, count = sum(episode.steps for episode in shown.episodes), len(shown.episodes)
    returns = ", ".join(f"{episode.total:.1f}" for episode in shown.episodes)
    text = f"{what}; {count} {'episode' if count == 1 else 'episodes'}, {steps} steps, return {returns}"
    lines = [text, *_notes(options, subject, shown, out)]
    data = asdict(shown) | {"file": None if out is None else str(out), "episodes": episode_rows(shown.episodes)}
    return Answer(data, "\n".join(lines))


def _notes(options: argparse.Namespace, subject: Subject, shown: Shown, out: Path | None) -> list[str]:
    """Say what a viewer of it should know."""
    notes = []
    if not shown.whole:
        limit = f"after {options.seconds or SECONDS} s of simulated time; --seconds sets another length"
        notes.append(f"it ends before the episodes do, {limit if out else 'because the window was closed'}")
    if subject.wrapped:
        notes.append(f"{options.name} is wrapped onto {subject.env} and not trained there")
    if shown.inputs == "observation":
        notes.append(f"{options.name} plays without adapters, so its inputs are the observation")
    return notes
