"""Small environments, models and policies whose numbers are known beforehand."""

import gymnasium
import numpy as np
import torch
from torch import nn

from transferkit.nn import Dynamics, JointInput
from transferkit.trainers.dyna.replay import Batch


class Counter(gymnasium.Env):
    """Observes its seed and its step; ends by itself after `length` steps; pays 1 a step, and NaN in step `bad_at`."""

    observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (2,))
    action_space = gymnasium.spaces.Box(-1, 1, (1,))

    def __init__(self, length, bad_at=None):
        self.length, self.bad_at = length, bad_at

    def reset(self, *, seed=None, options=None):
        self.seed, self.t = seed, 0
        return np.array([self.seed, 0], np.float32), {}

    def step(self, action):
        self.t += 1
        reward = float("nan") if self.t == self.bad_at else 1.0
        return np.array([self.seed, self.t], np.float32), reward, self.t == self.length, False, {}


class Remembering(gymnasium.Wrapper):
    """The inverted pendulum, which also shows what it was one step before, and the last action."""

    def __init__(self):
        super().__init__(gymnasium.make("InvertedPendulum-v5"))
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (9,))

    def reset(self, **options):
        self._before, info = super().reset(**options)
        return np.concatenate((self._before, self._before, np.zeros(1))), info

    def step(self, action):
        now, *rest = super().step(action)
        seen, self._before = np.concatenate((now, self._before, action)), now
        return seen, *rest


class Half(nn.Module):
    """A policy that halves its observation."""

    squash = True

    def forward(self, observation):
        return observation[:, :1] / 2, None


class Fixed(nn.Module):
    """An ensemble of one that always gives the same outputs."""

    def __init__(self, *outputs):
        super().__init__()
        self.outputs = torch.tensor(outputs)

    def forward(self, x):
        return self.outputs.expand(1, x.shape[-2], -1)


def fixed_model(*outputs, angles=()):
    """A model with these outputs: changes and the reward, their raw log-variances, the logit of termination."""
    return Dynamics(JointInput(None), Fixed(*outputs), (len(outputs) - 3) // 2, angles)


def transition(observation, action, reward, following, terminated):
    """A batch of one transition of numbers, `(1, 1)` and `(1,)`."""
    row = torch.tensor
    return Batch(row([[observation]]), row([[action]]), row([reward]), row([[following]]), row([terminated]))


def only(batch):
    """The transition of a batch of one, without its leading axis."""
    return Batch(*(tensor[0] for tensor in batch))
