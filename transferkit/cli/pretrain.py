"""`transferkit pretrain`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Annotated

import tyro

from transferkit.cli.answer import Answer, where_to_find
from transferkit.cli.environment import gathered, with_arguments
from transferkit.cli.flags import defaults, parse, settings_in
from transferkit.config import TrainConfig, check_read
from transferkit.pretrain import Recipe, pretrain
from transferkit.zoo.summary import Summary


def main(arguments: Sequence[str]) -> Answer:
    """Make a core; answers with its line of the zoo."""
    arguments = gathered(arguments)
    default = defaults(arguments)

    def command(
        recipe: Annotated[Recipe, tyro.conf.arg(name="")],
        config: Annotated[TrainConfig, tyro.conf.arg(name="")] = default,
        env_kwargs: tuple[str, ...] = (),
        vary: tuple[str, ...] = (),
    ) -> tuple[Recipe, TrainConfig]:
        """Train the members of a core, check each against the threshold, and write the artifact.

        An interrupted call goes on where it stopped.

        Args:
            recipe: the core.
            config: the training of each member.
            env_kwargs: NAME=VALUE keyword arguments of the environment.
            vary: NAME=VALUE changes of the robot, such as mass=0.7..1.3; a range is drawn every episode.
        """
        return recipe, replace(config, env=with_arguments(config.env, env_kwargs, vary))

    recipe, config = parse(command, "transferkit pretrain", arguments, [*Recipe.__dataclass_fields__, "env-kwargs", "vary"])
    check_read(config, settings_in(arguments))
    summary = Summary.of(pretrain(recipe, config))
    folder = recipe.zoo / recipe.id
    text = f"{folder}: score {summary.score_mean:.1f}, {summary.members} member{'s' * (summary.members > 1)}"
    return Answer({"id": recipe.id, **asdict(summary)}, f"{text}\n{where_to_find(folder)}")
