"""Episodes of a policy, shown while they are played."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import gymnasium
import numpy as np
from numpy.typing import NDArray

from transferkit.config.checks import EPISODES, Seed, check_kind, check_value
from transferkit.envs import derive_spec, opened, rollout
from transferkit.errors import ConfigError
from transferkit.files import check_new
from transferkit.play.film import film
from transferkit.play.limits import SECONDS, SECONDS_ALLOWED, STRIP, VIDEO
from transferkit.play.moment import Moment, inputs_of
from transferkit.play.strip import strip
from transferkit.play.viewer import viewer
from transferkit.record.play import Played, Subject
from transferkit.record.video import FPS
from transferkit.streams import Streams

if TYPE_CHECKING:
    from transferkit.envs import Transition
    from transferkit.play.moment import Inputs, Show
    from transferkit.policy.base import Policy


@dataclass(frozen=True)
class Shown:
    """What was seen."""

    episodes: list[Played]
    whole: bool
    """False if it ended before the episodes, because the file was long enough or the window was closed."""
    inputs: str
    """What was drawn beside it: `core input`, `observation`, or nothing."""


def play_episodes(
    subject: Subject,
    path: str | Path | None = None,
    *,
    episodes: int = 1,
    seed: int = 0,
    seconds: int = SECONDS,
    inputs: bool = False,
) -> Shown:
    """Play episodes with the deterministic action and show them; episode k starts as it does in an evaluation with the seed.

    Args:
        subject: from `load_subject`.
        path: a video (.mp4), or a strip of pictures of one episode (.png); by default MuJoCo's viewer, in real time.
        episodes: how many.
        seed: of their starts.
        seconds: of simulated time that a file shows at most; the viewer shows whole episodes.
        inputs: show what enters the core too; of a policy without adapters, the observation.

    Raises:
        ConfigError: the file exists or has another ending, or a strip of several episodes is asked for.
        EnvironmentContractError: no window opens, or the environment cannot be drawn.
        NotFiniteError: a NaN in an observation, an action or a reward.
    """
    check_kind("subject", subject, Subject, "load it with load_subject")
    for name, value, hint in (("episodes", episodes, EPISODES), ("seconds", seconds, SECONDS_ALLOWED)):
        check_value(name, value, Annotated[int, hint])
    check_value("seed", seed, Seed)
    if path is not None:
        check_kind("path", path, (str, Path), "give a file that ends in .mp4 or .png")
        path = Path(path)
    _check_path(path, episodes)
    spec = derive_spec(subject.env)
    seen = inputs_of(subject.policy, spec) if inputs else None
    step = spec.time_step or 1 / FPS
    with (
        opened(subject.env, render_mode=None if path is None else "rgb_array", **subject.rules) as env,
        _screen(path, env, step, seen) as show,
    ):
        playing = _Play(subject.policy, env, show, step, Streams(seed))
        playing.play(episodes, np.inf if path is None else round(seconds / step))
    return Shown(playing.played, playing.whole, "" if seen is None else seen.title)


def _check_path(path: Path | None, episodes: int) -> None:
    """Check where a play is written, before any work is done for it.

    Raises:
        ConfigError: the file exists, its folder does not, its name has another ending, or a strip has several episodes.
    """
    if path is None:
        return
    check_new(path, "out", VIDEO, STRIP)
    if path.suffix == STRIP and episodes > 1:
        raise ConfigError(f"{path} shows one episode", remedy="leave out {episodes}, or make a video: {out=FILE.mp4}")


def _screen(path: Path | None, env: gymnasium.Env, time_step: float, inputs: Inputs | None) -> AbstractContextManager[Show]:
    if path is None:
        return viewer(env, inputs)
    return film(path, env, time_step, inputs) if path.suffix == VIDEO else strip(path, env, inputs)


class _Play:
    """Lets a policy act, shows what it acts on, and counts."""

    def __init__(
        self, policy: Policy, env: gymnasium.Env, show: Callable[[Moment], bool], time_step: float, streams: Streams
    ) -> None:
        self._policy, self._env, self._show, self._time_step, self._streams = policy, env, show, time_step, streams
        self._watched, self._step, self._total = True, 0, 0.0
        self.played: list[Played] = []
        self.whole = True

    def play(self, episodes: int, most: float) -> None:
        """Play until the episodes are over, a number of steps is reached, or nobody watches."""
        for steps, step in enumerate(rollout(self, [self._env], self._seed_of, episodes=episodes), 1):
            self._count(step)
            over = step.done and step.episode == episodes - 1
            if not over and (steps >= most or not self._watched):
                self._stop(step)
                return

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Choose the action for one environment's observation, `(1, obs_dim)`, or hold it, and show the moment before."""
        self._look(observation[0], last=False)
        if self._step % self._policy.hold == 0:
            self._action = self._policy.act(observation)
        return self._action

    def _seed_of(self, episode: int) -> int:
        self._step, self._total = 0, 0.0
        return self._streams.episode(episode)

    def _count(self, step: Transition) -> None:
        self._step, self._total = step.step + 1, self._total + step.reward
        if step.done:
            self._look(step.next_observation, last=True)
            self._add(step)

    def _stop(self, step: Transition) -> None:
        self.whole = False
        if not step.done:
            self._add(step)

    def _add(self, step: Transition) -> None:
        self.played.append(Played(self._streams.episode(step.episode), self._step, self._total))

    def _look(self, observation: NDArray[np.float32], *, last: bool) -> None:
        moment = Moment(self._env, observation, self._step, self._step * self._time_step, last)
        self._watched = self._show(moment) and self._watched
