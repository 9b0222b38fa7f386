"""DAgger (Ross, Gordon & Bagnell 2011): a student acts, its teacher says what to do there, it learns from all that was seen."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch import Tensor

from transferkit.budget import Spent
from transferkit.distillation.config import ENVS
from transferkit.distillation.student import learn
from transferkit.distillation.teacher import watch
from transferkit.envs import VectorEnv, copies_of, dims
from transferkit.errors import RunDirectoryError
from transferkit.files import damaged_run
from transferkit.nn import Architecture
from transferkit.policy.base import ScratchPolicy
from transferkit.run import load_state, save_state
from transferkit.streams import Streams

if TYPE_CHECKING:
    from collections.abc import Sequence

    from transferkit.distillation.config import DistillConfig
    from transferkit.distillation.teacher import Watched
    from transferkit.envs import EnvLike
    from transferkit.policy.base import Policy
    from transferkit.run import Report

LAST = 5
"""How many times as many passes the last round has."""


@dataclass
class Seen:
    """What was seen so far, `(N, obs_dim)`, and what the teacher would have done, `(N, act_dim)`."""

    observation: Tensor
    wanted: Tensor

    def add(self, observation: Sequence[Tensor], wanted: Sequence[Tensor]) -> None:
        """Add the steps of a round."""
        self.observation = torch.cat([self.observation, *observation])
        self.wanted = torch.cat([self.wanted, *wanted])


class Rounds:
    """The rounds of one member, which go on where a killed process stopped."""

    def __init__(self, recipe: DistillConfig, env: EnvLike, teacher: Policy, path: Path, about: dict[str, Any]) -> None:
        """Take the student's environment, the teacher, the file of the state between rounds, and what makes the result."""
        self.recipe, self.teacher, self.path, self.about = recipe, teacher, path, about
        make = copies_of(env)
        pairs = [watch(make) for _ in range(ENVS)]
        self.watched: list[Watched] = [watched for _, watched in pairs]
        self.streams = Streams(recipe.seed)
        self.round = 0
        self.envs = VectorEnv([made for made, _ in pairs], self._seed_of)
        obs_dim, act_dim = dims(pairs[0][0])
        architecture = Architecture(obs_dim, act_dim, recipe.hidden, recipe.activation)
        self.student = ScratchPolicy.create(architecture, self.streams.torch("student"), init_std=1.0, normalize=True)
        self.seen = Seen(torch.empty(0, obs_dim), torch.empty(0, act_dim))
        self.spent = Spent()
        self.loss = float("nan")

    def run(self, report: Report | None) -> ScratchPolicy:
        """Play and learn in turns; returns the student."""
        if self.path.exists():
            self._restore()
        while self.round < self.recipe.rounds:
            started = time.monotonic()
            self._play()
            self._learn()
            self.round += 1
            self.spent.seconds += time.monotonic() - started
            save_state(self.path, self._state())
            if report is not None:
                report(self.spent, {})
        self.envs.close()
        return self.student

    def _play(self) -> None:
        """Play a round, the first by the teacher and all others by the student."""
        observation = self.envs.reset()
        seen, wanted = [], []
        for _ in range(self.recipe.steps_of_a_round):
            action = np.clip(self.teacher.act(np.stack([one.latest for one in self.watched])), -1.0, 1.0)
            seen.append(torch.from_numpy(observation))
            wanted.append(torch.from_numpy(action))
            step = self.envs.step(action if self.round == 0 else self.student.act(observation))
            observation = step.observation
            self.spent.episodes += int(step.done.sum())
            self.spent.steps += ENVS
        self.seen.add(seen, wanted)
        self.student.update_normalizer(torch.cat(seen))

    def _learn(self) -> None:
        recipe, last = self.recipe, self.round == self.recipe.rounds - 1
        self.loss = learn(
            self.student,
            self.seen.observation,
            self.seen.wanted,
            passes=recipe.passes * (LAST if last else 1),
            batch=recipe.batch,
            lr=recipe.lr,
            generator=self.streams.torch(f"batches of round {self.round}"),
            anneal=last,
        )

    def _seed_of(self, env: int, episode: int) -> int:
        return self.streams.integer("distillation", self.round, env, episode)

    def _state(self) -> dict[str, Any]:
        return {
            "about": self.about,
            "round": self.round,
            "spent": vars(self.spent),
            "loss": self.loss,
            "student": self.student.state_dict(),
            "seen": vars(self.seen),
        }

    def _restore(self) -> None:
        state = load_state(self.path)
        with damaged_run(self.path):
            if state["about"] != self.about:
                raise RunDirectoryError(
                    f"{self.path} is of another distillation of this name", remedy="delete it, or choose another {name}"
                )
            self.student.load_state_dict(state["student"])
            self.round, self.loss = state["round"], state["loss"]
            self.spent, self.seen = Spent(**state["spent"]), Seen(**state["seen"])
