"""Several environments side by side, exact to the episode and to the step.

Gymnasium's `SyncVectorEnv` steps all of its environments or none, so it can end a budget neither at an exact step nor at
an exact episode, and it reseeds neighbours with overlapping seeds. Here every episode starts from a seed of its own,
which also makes the state of an environment equal to (episode number, actions since its reset): enough to restore any
deterministic environment to the bit without knowing its internals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from transferkit.reading import FormatError, typed


@dataclass(frozen=True)
class Step:
    """One step of the first `n` environments of a `VectorEnv`."""

    observation: NDArray[np.float32]
    """What the next action is chosen from, `(n, obs_dim)`; after an ended episode, the first of the next one."""
    reward: NDArray[np.float32]
    """`(n,)`."""
    terminated: NDArray[np.bool_]
    """`(n,)`: the task ended; nothing follows."""
    truncated: NDArray[np.bool_]
    """`(n,)`: the time limit cut the episode; its value goes on."""
    final_observation: NDArray[np.float32]
    """What the step led to, `(n, obs_dim)`, before any reset."""

    @property
    def done(self) -> NDArray[np.bool_]:
        """`(n,)`: an episode ended, either way."""
        return self.terminated | self.truncated


class Count(Protocol):
    """Books one step of one environment."""

    def __call__(self, index: int, reward: float, *, terminated: bool, truncated: bool) -> bool:
        """Return True once the budget is reached."""
        ...


class VectorEnv:
    """Environments under `make_env`'s contract, stepped one after the other, reset in the step that ends an episode."""

    def __init__(
        self,
        envs: Sequence[gymnasium.Env],
        episode_seed: Callable[[int, int], int],
        *,
        overrun_steps: int = 0,
        hold: int = 1,
    ) -> None:
        """Take the environments and `episode_seed(env_index, episode_index)`, the seed each episode starts from.

        An action is held for `hold` control steps, or to the end of the episode, and its reward is their sum.
        In its first `overrun_steps` the first episode of an environment goes on after its end, as in the paper's code.
        """
        self._overrun_steps, self._hold = overrun_steps, hold
        self.envs = list(envs)
        self.num_envs = len(self.envs)
        self._episode_seed = episode_seed
        self._episode = [0] * self.num_envs
        self._actions: list[list[NDArray[np.float32]]] = [[] for _ in self.envs]

    def reset(self) -> NDArray[np.float32]:
        """Start episode 0 of every environment; returns observations `(num_envs, obs_dim)`."""
        return np.stack([self._start(i, 0) for i in range(self.num_envs)])

    def step(self, actions: NDArray[np.float32], count: Count | None = None) -> Step:
        """Step the environments in order with actions `(num_envs, act_dim)`.

        `count` is called after each single environment step; once it returns True this environment and those behind it are left
        as they are, and the result has that many fewer rows.

        Raises:
            NotFiniteError, EnvironmentContractError: an environment returned what it must not.
        """
        rows = []
        for i, action in enumerate(actions):
            row, over = self._held(i, action, count)
            rows.append(row)
            if over:
                break
        following, reward, terminated, truncated, final = zip(*rows, strict=True)
        return Step(
            np.stack(following),
            np.array(reward, np.float32),
            np.array(terminated),
            np.array(truncated),
            np.stack(final),
        )

    def state(self) -> dict[str, Any]:
        """Return what `restore` needs: per environment the episode number and the actions since its reset."""
        return {
            "episode": list(self._episode),
            "actions": [np.array(actions, np.float32).tolist() for actions in self._actions],
        }

    def restore(self, state: dict[str, Any]) -> NDArray[np.float32]:
        """Replay each running episode; returns the observations `(num_envs, obs_dim)` that the next actions are chosen from.

        Raises:
            FormatError: it is not the state of these environments.
        """
        episodes, played = typed(state["episode"], list[int]), typed(state["actions"], list[list[list[float]]])
        if not len(episodes) == len(played) == self.num_envs:
            raise FormatError(f"it has {len(episodes)} environments instead of {self.num_envs}")
        observations = []
        for i, (episode, actions) in enumerate(zip(episodes, played, strict=True)):
            observation = self._start(i, episode)
            for action in np.array(actions, np.float32).reshape(-1, *(self.envs[i].action_space.shape or ())):
                observation = self.envs[i].step(action)[0]
                self._actions[i].append(action)
            observations.append(observation)
        return np.stack(observations)

    def close(self) -> None:
        """Close every environment."""
        for env in self.envs:
            env.close()

    def _held(self, i: int, action: NDArray[np.float32], count: Count | None) -> tuple[tuple[Any, ...], bool]:
        """Step one environment for as long as an action is held; returns what came of it, and whether the budget is reached."""
        total, steps = 0.0, 0
        while True:
            observation, reward, terminated, truncated, _ = self.envs[i].step(action)
            self._actions[i].append(action.copy())
            terminated, total, steps = bool(terminated), total + float(reward), steps + 1
            truncated = bool(truncated and not terminated)
            overruns = self._episode[i] == 0 and len(self._actions[i]) < self._overrun_steps
            done = (terminated or truncated) and not overruns
            following = self._start(i, self._episode[i] + 1) if done else observation
            row = following, total, terminated, truncated, observation
            ends = {"terminated": done and terminated, "truncated": done and truncated}
            over = count is not None and count(i, float(reward), **ends)
            if over or done or steps == self._hold:
                return row, over
        raise AssertionError

    def _start(self, index: int, episode: int) -> NDArray[np.float32]:
        self._episode[index] = episode
        self._actions[index] = []
        return self.envs[index].reset(seed=self._episode_seed(index, episode))[0]
