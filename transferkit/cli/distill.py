"""`transferkit distill`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from transferkit.cli.answer import Answer, parser, where_to_find, whole
from transferkit.cli.environment import add_environment, environment
from transferkit.config.checks import AT_LEAST_ONE, NOT_NEGATIVE, WIDTH
from transferkit.errors import ConfigError


def main(arguments: Sequence[str]) -> Answer:
    """Train a student on other observations to do what a teacher does."""
    flags = parser(
        "distill",
        "Train a policy that observes less, or otherwise, to do what one does that observes all, and write it as a core. "
        "An interrupted call goes on after its last round. What is not given is as in transferkit.DistillConfig.",
    )
    flags.add_argument("teacher", metavar="CORE|RUN", help="a core's id or folder, or the directory of a finished run")
    add_environment(flags, "the student's environment; the teacher acts in the innermost one, before any wrapper")
    flags.add_argument("--name", help="of the core, without its version")
    flags.add_argument("--version", type=whole("version", AT_LEAST_ONE))
    flags.add_argument("--zoo", type=Path, metavar="FOLDER", help="folder of cores")
    flags.add_argument("--members", nargs="+", type=whole("member", NOT_NEGATIVE), help="of the teacher; by default all")
    flags.add_argument("--best", action="store_true", help="of a run, the policy that its evaluations found best")
    flags.add_argument("--steps", type=whole("steps", AT_LEAST_ONE), help="environment steps of a member")
    flags.add_argument("--rounds", type=whole("rounds", AT_LEAST_ONE), help="times that the student learns and then acts")
    flags.add_argument("--passes", type=whole("passes", AT_LEAST_ONE), help="over all that was seen, in each round")
    flags.add_argument("--batch", type=whole("batch", AT_LEAST_ONE))
    flags.add_argument("--lr", type=float, metavar="RATE", help="Adam's learning rate")
    flags.add_argument("--hidden", nargs="+", type=whole("hidden", WIDTH), metavar="WIDTH", help="its layers")
    flags.add_argument("--activation", help="of its layers")
    flags.add_argument("--seed", type=whole("seed", NOT_NEGATIVE))
    flags.add_argument("--threshold", type=float, metavar="RETURN", help="mean over 20 episodes that each has to reach")
    options = flags.parse_args(arguments)
    env = environment(options)
    if env is None or options.name is None:
        raise ConfigError("a student needs a name and an environment", remedy="give {name} and {env}")
    return _answer(options, env)


def _answer(options: argparse.Namespace, env: str) -> Answer:
    from transferkit.budget import Budget  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.cli.progress import progress  # noqa: PLC0415
    from transferkit.distillation import DistillConfig, distill  # noqa: PLC0415

    given: dict[str, Any] = {field.name: getattr(options, field.name) for field in fields(DistillConfig)}
    lists: dict[str, Any] = {name: tuple(value) for name, value in given.items() if isinstance(value, list)}
    recipe = DistillConfig(**{name: value for name, value in (given | lists).items() if value is not None})
    with progress(f"student of {options.teacher}", Budget(steps=recipe.steps)) as report:
        done = distill(options.teacher, env, recipe, report=report)
    score = done.card.score
    rows = [f"member {k}: {own:.1f}, its teacher {taught:.1f}" for k, (own, taught) in enumerate(done.pairs)]
    text = "\n".join(
        [
            f"{recipe.folder}: return {score.mean:.1f} over {len(rows)} member{'s' * (len(rows) > 1)}",
            *rows,
            where_to_find(recipe.folder),
        ]
    )
    data: dict[str, Any] = {
        "id": done.card.id,
        "folder": str(recipe.folder),
        "score_mean": score.mean,
        "members": list(score.members),
        "teacher": list(done.teacher),
        "digest": done.card.digest,
    }
    return Answer(data, text)
