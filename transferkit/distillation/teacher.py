"""A teacher inside a student's environment: it sees what the innermost environment observes, before any wrapper."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from numpy.typing import NDArray

from transferkit.envs import is_written, make_env, name_of, recorded
from transferkit.envs.layers import bounds, layers_of
from transferkit.errors import ConfigError
from transferkit.subject import load_subject

if TYPE_CHECKING:
    from transferkit.envs import EnvLike
    from transferkit.envs.contract import Contract
    from transferkit.policy.base import Policy
    from transferkit.record.play import Subject

LOGGER = logging.getLogger("transferkit")


class Watched(gymnasium.Wrapper):
    """Keeps the latest observation of an environment for somebody beside whoever acts."""

    latest: NDArray[np.float32]
    """`(obs_dim,)`."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Start an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        self.latest = np.array(observation, np.float32)
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:  # noqa: ANN401 - of any environment
        """Advance one step."""
        answer = self.env.step(action)
        self.latest = np.array(answer[0], np.float32)
        return answer


def watch(env: EnvLike) -> tuple[Contract, Watched]:
    """Make a student's environment, and watch its innermost one.

    Raises:
        ConfigError: there is nothing that a policy could take, or actions are others there.
    """
    made = make_env(env)
    layers = layers_of(made)
    depth = max((k for k, layer in enumerate(layers) if k and _is_flat(layer)), default=0)
    if not depth:
        raise ConfigError(f"no part of {name_of(made)} has one flat observation for a teacher", topic="environments")
    inner = layers[depth]
    own, outer = bounds(inner), bounds(made.env)
    assert isinstance(outer, Box)
    if not isinstance(own, Box) or own.shape != outer.shape or not np.allclose([own.low, own.high], [outer.low, outer.high]):
        raise ConfigError(
            f"the actions of {name_of(made)} are {outer}, those of the environment within are {own}, so a teacher there has "
            "others than its student",
            remedy="leave out what changes actions",
        )
    watched = Watched(inner)
    vars(layers[depth - 1])["env"] = watched
    return made, watched


class BesideStudent:
    """A teacher that acts in a student's environment, by what it observes itself."""

    def __init__(self, teacher: Policy, watched: Watched) -> None:
        self._teacher, self._watched = teacher, watched

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Choose the action `(1, act_dim)`; what the student observes is not looked at."""
        del observation
        return self._teacher.act(self._watched.latest[None])


def teacher_in(name: str, env: EnvLike, member: int | None, *, best: bool) -> Subject:
    """Load the teacher for what is innermost in a student's environment.

    Raises:
        ConfigError: it holds its actions for several steps.
    """
    made, watched = watch(env)
    home = recorded(watched.env)
    subject = load_subject(name, env=home if is_written(home) else watched.env, member=member, best=best, values=False)
    made.close()
    if subject.wrapped:
        LOGGER.warning("%s is wrapped onto %s and not trained there", name, home)
    if subject.policy.hold != 1:
        raise ConfigError(
            f"{name} holds an action for {subject.policy.hold} steps of {home}, and a student answers in every step",
            remedy="choose a {env} with its control step",
        )
    return subject


def _is_flat(env: gymnasium.Env) -> bool:
    space = env.observation_space
    return isinstance(space, Box) and len(space.shape) == 1
