"""Actions that are held for several steps while learning.

In a step of 8 ms an action changes next to nothing, and what it is worth is lost in the noise of the values around it. Held for
a few steps it has an effect that can be learnt, and exploration goes somewhere. The steps under one action are one transition
of a semi-Markov decision process (Sutton, Precup & Singh 1999).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from transferkit.reading import Count, FormatError, typed
from transferkit.trainers.dyna.replay import Batch

if TYPE_CHECKING:
    from transferkit.envs import Step


@dataclass(frozen=True)
class HeldState:
    """What a checkpoint says of a held action."""

    observation: list[list[float]]
    action: list[list[float]]
    reward: float
    age: Count


@dataclass(frozen=True)
class Held:
    """An action and what has come of it so far, in the one environment."""

    observation: NDArray[np.float32]
    """What the action was chosen from, `(1, obs_dim)`."""
    action: NDArray[np.float32]
    """`(1, act_dim)`."""
    reward: float = 0.0
    """Discounted sum."""
    age: int = 0
    """Steps."""

    def after(self, step: Step, discount: float) -> Held:
        """Add a step, at this discount a step."""
        return replace(self, reward=self.reward + discount**self.age * float(step.reward[0]), age=self.age + 1)

    def whole(self, step: Step) -> Step:
        """Everything up to the last step as one step."""
        return replace(step, reward=np.array([self.reward], np.float32))

    def state(self) -> dict[str, Any]:
        """Return plain numbers."""
        return {**vars(self), "observation": self.observation.tolist(), "action": self.action.tolist()}

    @classmethod
    def restored(cls, data: object, dims: tuple[int, int]) -> Held:
        """Make it from what `state` returned, for these numbers of observations and actions.

        Raises:
            FormatError: it is something else.
        """
        state = typed(data, HeldState)
        observation, action = (np.array(array, np.float32) for array in (state.observation, state.action))
        if (observation.shape, action.shape) != ((1, dims[0]), (1, dims[1])):
            raise FormatError("the held action has other dimensions")
        return cls(observation, action, state.reward, state.age)


def held_transitions(batch: Batch, steps: int, discount: float) -> tuple[Batch, Tensor]:
    """Join all runs of `steps` transitions, fewer before a termination, as if the mean of their actions was held.

    It is exact where that very action was held, and to first order elsewhere. With them come their weights, the discount to the
    power of the time since their episodes began.
    """
    following = (batch.next_observation[:-1] == batch.observation[1:]).all(-1) & (batch.terminated[:-1] == 0)
    goes_on = torch.cat((following, torch.zeros(1, dtype=torch.bool)))
    last = index = torch.arange(len(batch.reward))
    begins = torch.cat((torch.ones(1, dtype=torch.bool), ~following))[: len(index)]
    weights = discount ** (index - torch.where(begins, index, 0).cummax(0).values)
    reward, action, complete = batch.reward.clone(), batch.action.clone(), torch.ones_like(goes_on)
    for age in range(1, steps):
        complete &= goes_on[last] | (batch.terminated[last] > 0)
        going = goes_on[last]
        last = torch.where(going, last + 1, last)
        reward += torch.where(going, discount**age * batch.reward[last], 0.0)
        action += torch.where(going[:, None], batch.action[last], 0.0)
    action /= (last - index + 1)[:, None]
    followed = {"next_observation": batch.next_observation[last], "terminated": batch.terminated[last]}
    joined = batch._replace(action=action, reward=reward, **followed)
    return Batch(*(tensor[complete] for tensor in joined)), weights[complete]
