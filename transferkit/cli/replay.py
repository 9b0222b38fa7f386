"""`transferkit replay`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.output import check_new, print_json
from transferkit.errors import ConfigError

DIFFERENT = 1


def main(arguments: Sequence[str]) -> int:
    """Simulate a recording again; the exit status is 1 where `--check` finds a difference."""
    parser = argparse.ArgumentParser(
        "transferkit replay", description="Simulate a recording again from its states and actions."
    )
    parser.add_argument("file", type=Path, metavar="FILE.mcap")
    parser.add_argument("--check", action="store_true", help="exit with 1 unless every number is the same to the bit")
    parser.add_argument("--video", type=Path, metavar="FILE.mp4", help="draw it, by MuJoCo's offscreen renderer")
    parser.add_argument("--json", action="store_true", help="print one JSON object and nothing else on stdout")
    options = parser.parse_args(arguments)
    from transferkit.record.video import check_renderer, choose_renderer, video  # noqa: PLC0415

    if options.video:
        check_new(options.video, "--video")
        if options.video.suffix != ".mp4":
            raise ConfigError(f"{options.video} cannot be written; pass --video FILE.mp4")
        choose_renderer()
        check_renderer()
    from transferkit.record.reader import read, spec_of  # noqa: PLC0415
    from transferkit.record.replay import replay  # noqa: PLC0415

    if options.video:
        time_step = spec_of(read(options.file, about_only=True), options.file).time_step
        with video(options.video, time_step) as on_frame:
            found = replay(options.file, on_frame=on_frame, render=True)
    else:
        found = replay(options.file)
    if options.json:
        print_json(
            {
                "episodes": found.episodes,
                "steps": found.steps,
                "complete": found.complete,
                "difference": found.difference,
                "versions": found.versions,
            }
        )
    else:
        cut = "" if found.complete else f"; {options.file} is cut, this is its whole part"
        print(f"{found.episodes} episodes, {found.steps} steps: {_verdict(found.difference, found.versions)}{cut}")
    return DIFFERENT if options.check and found.difference else 0


def _verdict(difference: str, versions: dict[str, tuple[str, str]]) -> str:
    others = ", ".join(f"{name} {recorded} recorded, {here} here" for name, (recorded, here) in versions.items())
    if not difference:
        return "reproduced to the bit" + (f", with {others}" if others else "")
    return f"differs from {difference}; " + (f"versions differ: {others}" if others else "the versions are the same")
