"""Simulating a recording again from its states and actions."""

# pyright: reportAttributeAccessIssue=false
# mujoco's names come from a compiled module that pyright cannot read.
from __future__ import annotations

import base64
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from transferkit.envs import make_env
from transferkit.envs.access import Simulation, open_simulation
from transferkit.errors import RecordingError
from transferkit.record.format import Names
from transferkit.record.play import FULL_STATE, integration_state, state_size
from transferkit.record.reader import Contents, read, spec_of
from transferkit.run.streams import Streams
from transferkit.versions import versions

PHYSICS = ("mujoco", "gymnasium", "dm-control", "shimmy", "numpy")
"""Packages whose version can change a trajectory."""

OnFrame = Callable[[gymnasium.Env], None]


@dataclass(frozen=True)
class Replayed:
    """What replaying a recording came to."""

    episodes: int
    steps: int
    difference: str
    """Where the simulation first left the recording; empty where every number was the same, to the bit."""
    versions: dict[str, tuple[str, str]]
    """Of packages that differ: recorded, and here."""


def replay(path: Path, *, on_frame: OnFrame | None = None, render: bool = False) -> Replayed:
    """Reset to every episode's seed and first state, apply its actions, and compare states, observations and rewards.

    Raises:
        RecordingError: no recording of ours, or nothing whole in it.
    """
    contents = read(path)
    spec = spec_of(contents, path)
    if not contents.steps:
        raise RecordingError(f"{path} was cut before its first whole chunk; nothing can be replayed")
    env = make_env(spec.env_id, render_mode="rgb_array" if render else None, clip_actions=contents.about["clip_actions"])
    simulation = open_simulation(env)
    assert simulation is not None  # it was recorded
    streams, names, difference, episodes = Streams(contents.about["seed"]), Names.of(spec), "", 0
    for index, group in itertools.groupby(contents.steps, lambda step: step["episode"]):
        env.reset(seed=streams.integer("evaluation", index))
        found = _episode(env, simulation, list(group), names, on_frame)
        difference, episodes = difference or found, episodes + 1
    env.close()
    return Replayed(episodes, len(contents.steps), difference, _different_versions(contents))


def _episode(env: gymnasium.Env, simulation: Simulation, steps: list[Any], names: Names, on_frame: OnFrame | None) -> str:
    """Play one episode; where it first differs, or nothing."""
    mujoco.mj_setState(simulation.model, simulation.data, _state(steps[0]), FULL_STATE)
    difference, size = "", state_size(simulation)
    for recorded in steps:
        where = f"episode {recorded['episode']}, step {recorded['step']}"
        if not difference and not np.array_equal(integration_state(simulation, size), _state(recorded)):
            difference = f"{where}: the simulator's state"
        if on_frame is not None:
            on_frame(env)
        action = np.array([recorded["action"][name] for name in names.action], np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        difference = difference or _compare(where, recorded, names, observation, (float(reward), terminated, truncated))
    return difference


def _compare(
    where: str, recorded: dict[str, Any], names: Names, observation: NDArray[np.float32], outcome: tuple[float, bool, bool]
) -> str:
    if outcome != (recorded["reward"], recorded["terminated"], recorded["truncated"]):
        return f"{where}: reward {outcome[0]!r} in place of {recorded['reward']!r}, or its end"
    if "next_observation" in recorded:
        expected = np.array([recorded["next_observation"][name] for name in names.observation], np.float32)
        if not np.array_equal(expected, observation):
            return f"{where}: the final observation"
    return ""


def _state(recorded: dict[str, Any]) -> NDArray[np.float64]:
    return np.frombuffer(base64.b64decode(recorded["state"]), np.float64)


def _different_versions(contents: Contents) -> dict[str, tuple[str, str]]:
    recorded, here = contents.about["versions"], versions()
    return {name: (recorded[name], here[name]) for name in PHYSICS if recorded.get(name) != here[name]}
