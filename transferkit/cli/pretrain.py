"""`transferkit pretrain`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated

import tyro

from transferkit.cli.flags import parse, preset_from
from transferkit.cli.output import print_json
from transferkit.cli.zoo import summary
from transferkit.config import TrainConfig
from transferkit.pretrain import Recipe, pretrain


def main(arguments: Sequence[str]) -> None:
    """Make a core and print its line of the zoo."""
    default = preset_from(arguments)

    def command(
        recipe: Annotated[Recipe, tyro.conf.arg(name="")],
        config: Annotated[TrainConfig, tyro.conf.arg(name="")] = default,
        json: bool = False,
    ) -> Callable[[], None]:
        """Train the members of a core, check each against the threshold, and write the artifact.

        An interrupted call goes on where it stopped.

        Args:
            recipe: the core.
            config: the training of each member.
            json: print one JSON object and nothing else on stdout.
        """
        return partial(_pretrain, recipe, config, json=json)

    parse(command, "transferkit pretrain", arguments)()


def _pretrain(recipe: Recipe, config: TrainConfig, *, json: bool) -> None:
    line = summary(pretrain(recipe, config))
    if json:
        print_json(line)
    else:
        print(f"{recipe.zoo / recipe.id}: score {line['score_mean']:.1f}, {line['members']} members")
