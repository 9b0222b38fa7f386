"""Episodes under a deterministic policy: the one loop behind evaluation, health checks, recordings and studies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol

import gymnasium
import numpy as np
from numpy.typing import NDArray

from transferkit.errors import ConfigError


class Actor(Protocol):
    """Anything that maps observations `(B, obs_dim)` to deterministic actions `(B, act_dim)`.

    One with a `hold` is asked once in so many control steps of an episode, and its action holds meanwhile.
    """

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Choose the actions."""
        ...


class Transition(NamedTuple):
    """One step of one episode."""

    episode: int
    step: int
    observation: NDArray[np.float32]
    """What the action was chosen from, `(obs_dim,)`."""
    action: NDArray[np.float32]
    """`(act_dim,)`."""
    reward: float
    next_observation: NDArray[np.float32]
    """`(obs_dim,)`, the true one at the end of an episode."""
    terminated: bool
    truncated: bool
    info: dict[str, Any]

    @property
    def done(self) -> bool:
        """Whether the episode ended, either way."""
        return self.terminated or self.truncated


def rollout(
    actor: Actor,
    envs: Sequence[gymnasium.Env],
    seed_of: Callable[[int], int],
    *,
    episodes: float = np.inf,
    on_reset: Callable[[int], None] | None = None,
) -> Iterator[Transition]:
    """Play episodes side by side in `envs`, and yield every step, before the environment is reset.

    Args:
        actor: has `act`; it is asked once for all running episodes that need an action.
        envs: environments under `make_env`'s contract, no more than episodes.
        seed_of: gives the seed that an episode starts from, asked when it starts.
        episodes: how many; without a limit the caller stops.
        on_reset: called with the number of an episode when it has started.

    Raises:
        ConfigError: the actor's answer has not one row of actions for each observation.
    """
    observations: dict[int, NDArray[np.float32]] = {}
    steps: dict[int, int] = {}
    playing: dict[int, gymnasium.Env] = {}
    actions: dict[int, NDArray[np.float32]] = {}
    hold, shape = getattr(actor, "hold", 1), envs[0].action_space.shape or ()

    def start(episode: int, env: gymnasium.Env) -> None:
        observations[episode], steps[episode], playing[episode] = env.reset(seed=seed_of(episode))[0], 0, env
        if on_reset is not None:
            on_reset(episode)

    for episode, env in enumerate(envs):
        start(episode, env)
    upcoming = len(envs)
    while playing:
        asking = [episode for episode in playing if steps[episode] % hold == 0]
        if asking:
            chosen = actor.act(np.stack([observations[episode] for episode in asking]))
            if (answered := np.shape(chosen)) != (wanted := (len(asking), *shape)):
                raise ConfigError(
                    f"the policy answered {len(asking)} observations with an array of shape {answered} and not {wanted}",
                    remedy="return a row of actions, in [-1, 1], for each observation",
                )
            actions.update(zip(asking, chosen, strict=True))
        for episode, env in list(playing.items()):
            observation, step, action = observations[episode], steps[episode], actions[episode]
            following, reward, terminated, truncated, info = env.step(action)
            observations[episode], steps[episode] = following, step + 1
            taken = Transition(episode, step, observation, action, float(reward), following, terminated, truncated, info)
            yield taken
            if taken.done:
                del playing[episode], observations[episode], steps[episode], actions[episode]
                if upcoming < episodes:
                    start(upcoming, env)
                    upcoming += 1
