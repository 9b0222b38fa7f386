"""Simulating a recording again from its states and actions."""

from __future__ import annotations

import base64
import itertools
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from transferkit.envs import make_env, open_simulation
from transferkit.errors import RecordingError
from transferkit.physics import mujoco
from transferkit.record.format import Names
from transferkit.record.reader import read, spec_of
from transferkit.record.state import FULL_STATE, integration_state, state_size
from transferkit.streams import Streams
from transferkit.versions import versions

if TYPE_CHECKING:
    from transferkit.envs import Simulation
    from transferkit.record.reader import Contents

PHYSICS = ("mujoco", "gymnasium", "dm-control", "shimmy", "numpy")
"""Packages whose version can change a trajectory."""

OnFrame = Callable[[gymnasium.Env], None]


@dataclass(frozen=True)
class Replayed:
    """The outcome of replaying a recording."""

    episodes: int
    steps: int
    complete: bool
    """False for a file that was cut; this is its whole part."""
    difference: str
    """Where the simulation first left the recording; empty if every number was the same, to the bit."""
    versions: dict[str, tuple[str, str]]
    """Packages whose versions differ: recorded, and here."""


def replay_recording(path: str | Path, *, on_frame: OnFrame | None = None, render: bool = False) -> Replayed:
    """Reset to every episode's seed and first state, apply its actions, and compare states, observations and rewards.

    Raises:
        RecordingError: no recording of ours, or nothing whole in it.
    """
    path = Path(path)
    contents = read(path)
    spec = spec_of(contents, path)
    if not contents.steps:
        raise RecordingError(f"{path} holds no step, so nothing can be replayed", remedy="record it again")
    env = make_env(spec.env_id, render_mode="rgb_array" if render else None, clip_actions=contents.about["clip_actions"])
    simulation = open_simulation(env)
    assert simulation is not None  # it was recorded
    streams, names, difference, episodes = Streams(contents.about["seed"]), Names.of(spec), "", 0
    with closing(env):
        for index, group in itertools.groupby(contents.steps, lambda step: step["episode"]):
            observation, _ = env.reset(seed=streams.integer("evaluation", index))
            left = _episode(env, simulation, list(group), names, observation, on_frame)
            difference, episodes = difference or left, episodes + 1
    return Replayed(episodes, len(contents.steps), contents.complete, difference, _different_versions(contents))


def _episode(
    env: gymnasium.Env,
    simulation: Simulation,
    steps: list[Any],
    names: Names,
    observation: NDArray[np.float32],
    on_frame: OnFrame | None,
) -> str:
    """Play one episode; returns where it first differs, or nothing."""
    size, difference = state_size(simulation), ""
    if len(_state(steps[0])) != size:
        return f"episode {steps[0]['episode']}: its states have {len(_state(steps[0]))} numbers, this MuJoCo's {size}"
    mujoco.mj_setState(simulation.model, simulation.data, _state(steps[0]), FULL_STATE)
    for step in steps:
        if on_frame is not None:
            on_frame(env)
        before = integration_state(simulation, size)
        action = _vector(step["action"], names.action)
        following, *outcome = env.step(action)
        control = simulation.data.ctrl.tolist()
        difference = difference or _compare(step, names, before, observation, control, following, outcome)
        observation = following
    return difference


def _compare(
    step: dict[str, Any],
    names: Names,
    before: NDArray[np.float64],
    observation: NDArray[np.float32],
    control: list[float],
    following: NDArray[np.float32],
    outcome: Sequence[Any],
) -> str:
    same = {
        "the simulator's state": np.array_equal(before, _state(step)),
        "the observation": np.array_equal(observation, _vector(step["observation"], names.observation)),
        "the control": control == list(step["control"].values()),
        "the reward": float(outcome[0]) == step["reward"],
        "its end": (outcome[1], outcome[2]) == (step["terminated"], step["truncated"]),
        "the final observation": "next_observation" not in step
        or np.array_equal(following, _vector(step["next_observation"], names.observation)),
    }
    wrong = [what for what, right in same.items() if not right]
    return f"episode {step['episode']}, step {step['step']}: {wrong[0]}" if wrong else ""


def _vector(values: dict[str, float], names: Sequence[str]) -> NDArray[np.float32]:
    return np.array([values[name] for name in names], np.float32)


def _state(recorded: dict[str, Any]) -> NDArray[np.float64]:
    return np.frombuffer(base64.b64decode(recorded["state"]), np.float64)


def _different_versions(contents: Contents) -> dict[str, tuple[str, str]]:
    recorded, here = contents.about["versions"], versions()
    return {name: (recorded[name], here[name]) for name in PHYSICS if recorded.get(name) != here[name]}
