"""Keeping the best policy that was seen to act, as later ones can be worse."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import torch
from torch import nn

if TYPE_CHECKING:
    from torch import Tensor

    from transferkit.policy.base import Policy

CONFIRMED_BY = 2
"""Episodes in which a policy must be better than the best so far; the least of them is its score."""


class Keeper:
    """Plays some episodes by a copy of the policy as it is at their start, without noise, and keeps the copies of the best.

    Checkpoints of policies by their own episodes are those of Fujimoto et al. 2023 (TD7); learning goes on meanwhile here.
    """

    def __init__(
        self, live: Mapping[str, nn.Module], candidate: Mapping[str, nn.Module], kept: Mapping[str, nn.Module], every: int
    ) -> None:
        """All have the same modules by name, `policy` among them; every `every`-th episode is played by `candidate`."""
        self._live, self.candidate, self.kept, self._every = live, candidate, kept, every
        self._best: list[float] = []
        self._scores: list[float] = []
        self._return, self._episodes, self.acts = 0.0, 0, False

    @property
    def policy(self) -> Policy:
        """The policy that plays the episode, if this `acts`."""
        policy: Any = self.candidate["policy"]
        return policy

    def add(self, reward: float, *, done: bool) -> None:
        """Book a step; at the end of an episode judge who played it and choose who plays the next."""
        self._return += reward
        if not done:
            return
        if self.acts:
            self._judge()
        self._episodes, self._return = self._episodes + 1, 0.0
        if not self._scores and self._episodes % self._every == 0:
            _copy(self._live, self.candidate)
        self.acts = bool(self._scores) or self._episodes % self._every == 0

    def follow(self) -> None:
        """Keep the policy as it is, as long as no better one was found."""
        if not self._best:
            _copy(self._live, self.kept)

    def state(self) -> dict[str, Any]:
        """Return plain numbers and the copies' weights."""
        return {
            "best": list(self._best),
            "scores": list(self._scores),
            "return": self._return,
            "episodes": self._episodes,
            "acts": self.acts,
            "candidate": {name: module.state_dict() for name, module in self.candidate.items()},
            "kept": {name: module.state_dict() for name, module in self.kept.items()},
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        self._best, self._scores = list(state["best"]), list(state["scores"])
        self._return, self._episodes, self.acts = state["return"], state["episodes"], state["acts"]
        for name in self.kept:
            self.candidate[name].load_state_dict(state["candidate"][name])
            self.kept[name].load_state_dict(state["kept"][name])

    def _judge(self) -> None:
        self._scores.append(self._return)
        if self._best and min(self._scores) <= self._best[0]:
            self._scores = []
        elif len(self._scores) == CONFIRMED_BY:
            self._best, self._scores = [min(self._scores)], []
            _copy(self.candidate, self.kept)


@torch.no_grad()
def _copy(source: Mapping[str, nn.Module], target: Mapping[str, nn.Module]) -> None:
    for name, module in source.items():
        values: dict[str, Tensor] = module.state_dict()
        target[name].load_state_dict(values)
