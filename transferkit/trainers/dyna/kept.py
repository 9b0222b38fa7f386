"""What a run of DYNA-DDPG would end with: the policy of its best stretch, and the critics and the model of then."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from torch import nn

if TYPE_CHECKING:
    from transferkit.policy.base import Policy


class Kept:
    """Copies of modules that share one normaliser, which is copied with them: what is learnt meanwhile changes nothing here."""

    def __init__(self, policy: Policy, learner: Policy, parts: Mapping[str, nn.Module]) -> None:
        """Keep copies in `policy`, and beside it of parts that have the learner's normaliser."""
        shared = {} if learner.normalizer is None else {id(learner.normalizer): policy.normalizer}
        beside = {name: copy.deepcopy(part, dict(shared)) for name, part in parts.items()}
        self._modules: dict[str, nn.Module] = {"policy": policy, **beside}
        self._names = tuple[str, ...]()
        self._peak = self._now()

    def follow(self, policy: Policy, trained: Mapping[str, nn.Module]) -> None:
        """Take what a policy is now, and what was trained beside it so far."""
        self._names = tuple(trained)
        for name, module in {"policy": policy, **trained}.items():
            self._modules[name].load_state_dict(module.state_dict())

    def remember(self) -> None:
        """This is the peak, until there is a higher one."""
        self._peak = copy.deepcopy(self._now())

    def recall(self) -> None:
        """Go back to the peak."""
        self._take(self._peak)

    def trained(self) -> dict[str, nn.Module]:
        """What was trained beside the policy."""
        return {name: self._modules[name] for name in self._names}

    def state(self) -> dict[str, Any]:
        """Return what `restore` takes."""
        return {"now": self._now(), "peak": self._peak}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        self._take(state["now"])
        self._peak = state["peak"]

    def _now(self) -> dict[str, Any]:
        return {"names": list(self._names), "modules": {name: module.state_dict() for name, module in self._modules.items()}}

    def _take(self, state: Mapping[str, Any]) -> None:
        self._names = tuple(state["names"])
        for name, module in self._modules.items():
            module.load_state_dict(state["modules"][name])
