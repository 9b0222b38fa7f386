"""Whether a run's updates are compiled."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from transferkit.envs import NO_LIMIT
from transferkit.errors import ConfigError
from transferkit.nn.compiled import cannot_compile

if TYPE_CHECKING:
    from transferkit.config import TrainConfig

LEAST_UPDATES = 30_000
"""Updates that a run must have room for: compiling takes 20 seconds once, 4 from the cache, and saves 1 to 2 ms an update."""

STEPS_PER_SECOND = 10
"""Environment steps that a budget in seconds is taken for: compiling must not use up a good part of it."""

EPISODE_SHARE = 0.1
"""Share of its limit that an episode of a budget is taken for: robots that begin to learn fall."""

REMEDY = "install g++, or name another compiler in CXX"


def is_compiled(
    config: TrainConfig,
    episode_limit: Callable[[], int | None],
    time_step: Callable[[], float],
    *,
    recorded: bool | None = None,
) -> bool:
    """Decide it: as it was `recorded` if the run goes on, else as `config.compile` says.

    The environment's limit of steps and its time step are asked for if the decision needs them.

    Raises:
        ConfigError: it must be, and cannot; or the record says the opposite.
    """
    if recorded is not None:
        if config.compile not in ("auto", "on" if recorded else "off"):
            raise ConfigError(
                f"{{compile={config.compile}}} differs from the run's record: its updates are "
                f"{'' if recorded else 'not '}compiled",
                remedy="leave {compile} out, or train into another {out}",
            )
        return recorded
    if is_captured(config):
        return config.compile != "off"
    if config.compile == "off" or (config.compile == "auto" and not _pays(config, episode_limit, time_step)):
        return False
    if config.compile == "on":
        check_compiler()
    elif reason := cannot_compile():
        logging.getLogger("transferkit").warning("updates are not compiled, which would be faster: %s; %s", reason, REMEDY)
        return False
    return True


def is_captured(config: TrainConfig) -> bool:
    """Whether the updates would be replayed as CUDA graphs, which takes no compiler and no time."""
    return config.device.startswith("cuda") and config.algo == "dyna-ddpg"


def check_compiler() -> None:
    """Try to compile, before anything depends on it.

    Raises:
        ConfigError: that fails.
    """
    if reason := cannot_compile():
        raise ConfigError(f"the updates cannot be compiled: {reason}", remedy=REMEDY)


def _pays(config: TrainConfig, episode_limit: Callable[[], int | None], time_step: Callable[[], float]) -> bool:
    """Whether the budget has room for enough updates; PPO's on an accelerator nobody has measured."""
    if config.device != "cpu":
        return False
    by_episodes = EPISODE_SHARE * config.episodes * (episode_limit() or NO_LIMIT) if config.episodes else 0
    steps = min(limit for limit in (config.steps, by_episodes, (config.seconds or 0) * STEPS_PER_SECOND) if limit)
    return steps * _updates_per_step(config, time_step) >= LEAST_UPDATES


def _updates_per_step(config: TrainConfig, time_step: Callable[[], float]) -> float:
    """About how many updates follow an environment step."""
    if config.algo == "dyna-ddpg":
        seconds = time_step()
        hold = 1 if config.core else config.dyna.hold_steps(seconds)
        return config.dyna.updates(hold, seconds) / hold
    ppo, imagined = config.ppo.epochs / config.ppo.batch_size, config.dyna_ppo
    of_imagined = imagined.updates * imagined.rollouts * imagined.horizon / config.model.every
    return ppo * (of_imagined if config.algo == "dyna-ppo" else 1)
