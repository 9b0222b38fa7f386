"""`transferkit replay`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.cli.answer import Answer, parser
from transferkit.cli.environment import add_environment, environment
from transferkit.files import check_new
from transferkit.renderer import choose_renderer

if TYPE_CHECKING:
    from transferkit.record.replay import Replayed

DIFFERENT = 1


def main(arguments: Sequence[str]) -> Answer:
    """Simulate a recording again; the exit status is 1 if `--check` finds a difference."""
    flags = parser("replay", "Simulate a recording again from its states and actions.")
    flags.add_argument("file", type=Path, metavar="FILE.mcap")
    add_environment(flags, "the recording's environment, if no id makes it again or its module may be run")
    flags.add_argument("--check", action="store_true", help="exit with 1 unless every number is the same to the bit")
    flags.add_argument("--video", type=Path, metavar="FILE.mp4", help="draw it, by MuJoCo's offscreen renderer")
    options = flags.parse_args(arguments)
    env = environment(options)
    replayed = _with_video(options.file, options.video, env) if options.video else _replay(options.file, env)
    flaw = f"; {options.file} {replayed.flaw}, this is its whole part" if replayed.flaw else ""
    text = f"{replayed.episodes} episode{'s' * (replayed.episodes != 1)}, {replayed.steps} steps: {_verdict(replayed)}{flaw}"
    return Answer(asdict(replayed), text, DIFFERENT if options.check and replayed.difference else 0)


def _replay(file: Path, env: str | None) -> Replayed:
    from transferkit.record.replay import replay_recording  # noqa: PLC0415 - torch takes seconds to import

    return replay_recording(file, env=env)


def _with_video(file: Path, out: Path, env: str | None) -> Replayed:
    check_new(out, "video", ".mp4")
    choose_renderer()  # before mujoco is imported: PyOpenGL stays with what it was first loaded for
    from transferkit.record.reader import about_of, read  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.record.replay import STATELESS, replay_recording  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.record.video import frame, video  # noqa: PLC0415

    about = about_of(read(file, about_only=True), file, STATELESS)
    with video(out, about.spec.time_step, frame) as on_frame:
        return replay_recording(file, env=env, on_frame=on_frame, render=True)


def _verdict(replayed: Replayed) -> str:
    others = ", ".join(f"{name} {recorded} recorded, {here} here" for name, (recorded, here) in replayed.versions.items())
    if not replayed.difference:
        return "reproduced to the bit" + (f", with {others}" if others else "")
    return f"differs from {replayed.difference}; " + (f"versions differ: {others}" if others else "the versions are the same")
