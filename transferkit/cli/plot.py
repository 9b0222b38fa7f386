"""`transferkit plot`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Answer, parser, whole
from transferkit.config.checks import NOT_NEGATIVE
from transferkit.errors import ConfigError
from transferkit.files import check_new


def main(arguments: Sequence[str]) -> Answer:
    """Draw a run or a recording."""
    flags = parser(
        "plot",
        "Draw the learning curve of a run and the errors of its learnt model, or the traces of a recorded episode.",
    )
    flags.add_argument("run", metavar="RUN|FILE.mcap", type=Path, help="run directory, finished or not, or a recording")
    flags.add_argument("--out", type=Path, help="new PNG, SVG or PDF; by default RUN/curves.png, FILE.png, or FILE_EPISODE.png")
    flags.add_argument("--episode", type=whole("episode", NOT_NEGATIVE), help="of a recording, by default 0")
    flags.add_argument("--mapping", type=Path, metavar="FILE.toml", help="where another tool's recording has what")
    options = flags.parse_args(arguments)
    from transferkit.plots import draw_recording, draw_run  # noqa: PLC0415 - matplotlib takes a second to import

    if options.run.is_dir():
        if options.episode is not None or options.mapping is not None:
            raise ConfigError("{episode} and {mapping} are of a recording, and this is a run", remedy="leave them out")
        out = options.out or options.run / "curves.png"
        if options.out:
            check_new(out, "out")
        draw_run(options.run, out)  # a run's own picture is drawn anew
    else:
        which = "" if options.episode is None else f"_{options.episode}"
        out = options.out or options.run.with_name(f"{options.run.stem}{which}.png")
        check_new(out, "out")
        draw_recording(options.run, out, episode=options.episode or 0, mapping=options.mapping)
    return Answer({"picture": str(out)}, str(out))
