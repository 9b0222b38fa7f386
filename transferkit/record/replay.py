"""Simulating a recording again from its states and actions."""

from __future__ import annotations

import base64
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from transferkit.envs import Simulation, dims, id_from_file, open_simulation, opened
from transferkit.errors import RecordingError
from transferkit.physics import mujoco
from transferkit.record.format import Names
from transferkit.record.reader import about_of, read
from transferkit.record.state import FULL_STATE, integration_state, state_size
from transferkit.streams import Streams
from transferkit.versions import versions

if TYPE_CHECKING:
    from transferkit.envs import EnvLike
    from transferkit.record.format import About, Step

PHYSICS = ("mujoco", "gymnasium", "dm-control", "shimmy", "numpy")
"""Packages whose version can change a trajectory."""

STATELESS = "only its own have the seeds and states that a replay needs; plot it with {mapping}"
"""Remedy for a recording of another tool."""

OnFrame = Callable[[gymnasium.Env], None]


@dataclass(frozen=True)
class Replayed:
    """The outcome of replaying a recording."""

    episodes: int
    steps: int
    flaw: str
    """Why steps are missing, such as "is cut"; empty for a file that is complete."""
    difference: str
    """Where the simulation first left the recording; empty if every number was the same, to the bit."""
    versions: dict[str, tuple[str, str]]
    """Packages whose versions differ: recorded, and here."""


def replay_recording(
    path: str | Path, *, env: EnvLike | None = None, on_frame: OnFrame | None = None, render: bool = False
) -> Replayed:
    """Reset to every episode's seed and first state, apply its actions, and compare states, observations and rewards.

    Args:
        path: the recording.
        env: the recording's environment, which is needed if no id makes it again or its id imports a module.
        on_frame: called with the environment before every step.
        render: make the environment so that it can be drawn.

    Raises:
        RecordingError: no recording of ours, nothing whole in it, or it does not fit the environment.
        EnvironmentContractError: its environment cannot be made, or needs a module that was not named.
    """
    path = Path(path)
    contents = read(path)
    about = about_of(contents, path, STATELESS)
    names = Names.of(about.spec)
    episodes = [_from_its_start(list(steps)) for _, steps in itertools.groupby(contents.steps, lambda step: step.episode)]
    episodes = [steps for steps in episodes if steps]
    if not episodes:
        raise RecordingError(f"{path} holds no step, so nothing can be replayed", remedy="record it again")
    home = id_from_file(about.spec.env_id, path, env, only=True) if env is None or isinstance(env, str) else env
    with opened(home, render_mode="rgb_array" if render else None, **about.rules) as made:
        tape = _Tape(made, _simulation(made, path), names, path)
        if dims(made) != (about.spec.obs_dim, about.spec.act_dim):
            raise RecordingError(
                f"{path} was recorded in another environment than this {about.spec.env_id}", remedy="name its own: {env}"
            )
        streams, differences = Streams(about.seed), []
        for steps in episodes:
            observation, _ = made.reset(seed=streams.episode(steps[0].episode))
            differences.append(tape.play(steps, observation, on_frame))
    difference = next(filter(None, differences), "")
    return Replayed(len(episodes), sum(map(len, episodes)), contents.flaw, difference, different_versions(about))


def _from_its_start(steps: list[Step]) -> list[Step]:
    """Take an episode's steps from its first one up to a gap, where a chunk of the file is damaged."""
    return [step for k, step in enumerate(steps) if step.step == k]


def _simulation(env: gymnasium.Env, path: Path) -> Simulation:
    simulation = open_simulation(env)
    if simulation is None:
        raise RecordingError(f"{path} names an environment that is not MuJoCo, which no recording is of")
    return simulation


@dataclass(frozen=True)
class _Tape:
    """An environment in which episodes are played again."""

    env: gymnasium.Env
    simulation: Simulation
    names: Names
    path: Path

    def play(self, steps: Sequence[Step], observation: NDArray[np.float32], on_frame: OnFrame | None) -> str:
        """Play one episode; returns where it first differs, or nothing."""
        model, data = self.simulation.model, self.simulation.data
        size, difference = state_size(self.simulation), ""
        first = self._state(steps[0])
        if len(first) != size:
            return f"episode {steps[0].episode}: its states have {len(first)} numbers, this MuJoCo's {size}"
        mujoco.mj_setState(model, data, first, FULL_STATE)
        for step in steps:
            if on_frame is not None:
                on_frame(self.env)
            before = integration_state(self.simulation, size)
            following, *outcome = self.env.step(self._vector(step.action, self.names.action))
            control = data.ctrl.tolist()
            difference = difference or self._compare(step, before, observation, control, following, outcome)
            observation = following
        return difference

    def _compare(
        self,
        step: Step,
        before: NDArray[np.float64],
        observation: NDArray[np.float32],
        control: list[float],
        following: NDArray[np.float32],
        outcome: Sequence[Any],
    ) -> str:
        names, last = self.names.observation, step.next_observation
        same = {
            "the simulator's state": np.array_equal(before, self._state(step)),
            "the observation": np.array_equal(observation, self._vector(step.observation, names)),
            "the control": control == list(step.control.values()),
            "the reward": float(outcome[0]) == step.reward,
            "its end": (outcome[1], outcome[2]) == (step.terminated, step.truncated),
            "the final observation": last is None or np.array_equal(following, self._vector(last, names)),
        }
        wrong = [what for what, right in same.items() if not right]
        return f"episode {step.episode}, step {step.step}: {wrong[0]}" if wrong else ""

    def _vector(self, values: dict[str, float], names: Sequence[str]) -> NDArray[np.float32]:
        try:
            return np.array([values[name] for name in names], np.float32)
        except KeyError as error:
            raise RecordingError(f"{self.path}: a step lacks {error}", remedy="record it again") from None

    def _state(self, step: Step) -> NDArray[np.float64]:
        try:
            state = np.frombuffer(base64.b64decode(step.state, validate=True), np.float64)
        except ValueError:
            state = np.array([np.nan])
        if not np.isfinite(state).all():
            raise RecordingError(f"{self.path}: the state of step {step.step} is none", remedy="record it again")
        return state


def different_versions(about: About) -> dict[str, tuple[str, str]]:
    """Find the packages of the physics that had another version: recorded, and here."""
    here = versions()
    return {name: (about.versions.get(name, "?"), here[name]) for name in PHYSICS if about.versions.get(name) != here[name]}
