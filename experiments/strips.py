"""Draw the docs' strips: cores on their own robots and, untrained, on others: `python -m experiments.strips [NAME...]`.

Existing pictures are drawn again only if they are named; a picture has few colours, so that it stays small.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from transferkit.cli.answer import Parser
from transferkit.cli.endings import ended
from transferkit.errors import UnknownNameError
from transferkit.play.episodes import play_episodes
from transferkit.subject import load_subject
from transferkit.zoo.catalog import find_card

PICTURES = Path(__file__).parents[1] / "docs" / "images" / "robots"
COLOURS, SECONDS = 48, 4

STRIPS = {
    **dict.fromkeys(
        (
            "cartpole-balance-v2",
            "cartpole-swingup-v2",
            "half-cheetah-v1",
            "hopper-family-v1",
            "hopper-stand-v1",
            "hopper-v1",
            "inverted-pendulum-family-v1",
            "inverted-pendulum-v2",
            "pendulum-swingup-v1",
            "reacher-v1",
            "swimmer-v1",
            "walker-stand-v1",
            "walker-walk-v1",
            "walker2d-v1",
        )
    ),
    "inverted-pendulum-v2_cartpole-balance": "dm_control/cartpole-balance-v0",
    "cartpole-swingup-v2_InvertedPendulum": "InvertedPendulum-v5",
    "hopper-v1_Walker2d": "Walker2d-v5",
    "hopper-v1_walker-stand": "dm_control/walker-stand-v0",
    "half-cheetah-v1_cheetah-run": "dm_control/cheetah-run-v0",
    "walker2d-v1_walker-walk": "dm_control/walker-walk-v0",
    "walker-walk-v1_Walker2d": "Walker2d-v5",
    "hopper-v1_hopper-stand": "dm_control/hopper-stand-v0",
    "walker-stand-v1_hopper-stand": "dm_control/hopper-stand-v0",
    "hopper-stand-v1_walker-stand": "dm_control/walker-stand-v0",
}
"""Pictures by name, which begins with the core's; the environment, or None for the core's own."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw; the exit status is 2 if an argument is wrong."""
    parser = Parser(prog="experiments.strips", description=__doc__)
    parser.add_argument("names", nargs="*")
    return ended(lambda: draw_all(parser.parse_args(arguments).names), stopped="stopped; the same command goes on")


def draw_all(names: Sequence[str]) -> int:
    """Draw what is missing or named; 0.

    Raises:
        UnknownNameError: there is no such strip.
    """
    for name in names:
        if name not in STRIPS:
            raise UnknownNameError("strip", name, list(STRIPS))
    PICTURES.mkdir(exist_ok=True)
    for name, env in STRIPS.items():
        if name in names or not (PICTURES / f"{name}.png").exists():
            draw(name.partition("_")[0], env, PICTURES / f"{name}.png")
    return 0


def draw(core: str, env: str | None, path: Path) -> None:
    """Draw the first member's first seconds from the start that an evaluation with seed 0 has."""
    with tempfile.TemporaryDirectory() as folder:
        full = Path(folder) / "full.png"
        shown = play_episodes(load_subject(core, env=env), full, seconds=SECONDS)
        Image.open(full).convert("RGB").quantize(COLOURS).save(path, optimize=True)
    where = env or find_card(core).source.env_id
    print(f"{path.name}: {core} on {where}, {shown.episodes[0].steps} steps", flush=True)


if __name__ == "__main__":
    sys.exit(main())
