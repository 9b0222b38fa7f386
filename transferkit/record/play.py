"""Playing episodes with a policy and recording them."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from contextlib import closing
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray

from transferkit.envs import derive_spec, make_env
from transferkit.envs.access import Simulation, open_simulation
from transferkit.envs.make import NO_LIMIT
from transferkit.errors import RecordingError, TransferkitError
from transferkit.nn import Value
from transferkit.policy import Policy
from transferkit.record.format import SCENE_HZ, Names, about
from transferkit.record.scene import Transforms, scene
from transferkit.record.state import integration_state, named_parts, state_size
from transferkit.record.writer import Recorder, Steps
from transferkit.run.streams import Streams
from transferkit.versions import command, versions

ROWS = 250
"""Steps that are encoded together; what lies between the core's ends is computed for all of them at once."""


@dataclass(frozen=True)
class Subject:
    """What is recorded: a policy, and whatever is known beside it."""

    policy: Policy
    env: str
    value: Value | None = None
    clip_actions: bool = True
    about: Mapping[str, Any] | None = None
    """JSON values for the metadata: the core, its digest, the run."""


@dataclass(frozen=True)
class Played:
    """A recorded episode."""

    seed: int
    steps: int
    total: float


def record(subject: Subject, path: Path, *, episodes: int = 1, seed: int = 0) -> list[Played]:
    """Play episodes with the deterministic action and write them; episode k starts as it does in an evaluation with the seed.

    Raises:
        RecordingError: the file exists, or the environment is not MuJoCo.
        NotFiniteError: a NaN in an observation, an action or a reward.
    """
    env, spec = make_env(subject.env, clip_actions=subject.clip_actions), derive_spec(subject.env)
    simulation = open_simulation(env)
    if simulation is None:
        raise RecordingError(f"{spec.env_id} is no MuJoCo environment, whose state could be recorded; record another --env")
    names = Names.of(spec, **subject.policy.trace_names())
    more = {
        "versions": versions(),
        "seed": seed,
        "episodes": episodes,
        "command": command(),
        "clip_actions": subject.clip_actions,
        **(subject.about or {}),
    }
    streams = Streams(seed)
    with closing(env), Recorder(path, about(spec, **more), names, spec.time_step) as recorder:
        return [_episode(recorder, subject, env, simulation, k, streams.integer("evaluation", k)) for k in range(episodes)]


def record_evaluation(policy: Policy, env: str, clip_actions: bool, about: Mapping[str, Any], run: Path, steps: int) -> None:  # noqa: FBT001
    """An episode of a policy in training as `recordings/step_<N>.mcap` of its run, in place of one that a killed process began.

    What goes wrong is logged as a warning: training is worth more than its recording.
    """
    path = run / "recordings" / f"step_{steps}.mcap"
    try:
        path.parent.mkdir(exist_ok=True)
        path.unlink(missing_ok=True)
        record(Subject(policy, env, clip_actions=clip_actions, about={**about, "steps": steps}), path)
    except (TransferkitError, OSError) as error:
        logging.getLogger("transferkit").warning("not recorded: %s", error)


def reward_terms(info: Mapping[str, Any]) -> dict[str, float]:
    """The terms of the reward that an environment names, as Gymnasium's do."""
    return {name: float(value) for name, value in info.items() if name.startswith("reward_") and isinstance(value, Real)}


def _episode(recorder: Recorder, subject: Subject, env: gymnasium.Env, simulation: Simulation, index: int, seed: int) -> Played:
    model = simulation.model
    every = max(1, round(1 / (SCENE_HZ * recorder.time(1) / 1e9))) if recorder.time(1) else 1
    observation, _ = env.reset(seed=seed)
    poses, start, total, steps = Transforms(model), recorder.steps, 0.0, 0
    recorder.add_scene(recorder.time(start), scene(model, recorder.time(start)))
    size = state_size(simulation)
    states = np.empty((ROWS + 1, size))
    states[0] = integration_state(simulation, size)
    rows, terminated, truncated = [], False, False
    while not (terminated or truncated):
        action = subject.policy.act(observation[None])[0]
        following, reward, terminated, truncated, info = env.step(action)
        rows.append((observation, action, reward, info))
        observation, steps = following, steps + 1
        truncated = truncated or steps >= NO_LIMIT
        states[len(rows)] = integration_state(simulation, size)
        if terminated or truncated or len(rows) == ROWS:
            taken = _steps(rows, states[: len(rows) + 1], simulation, following, terminated=terminated, truncated=truncated)
            first = steps - len(rows)
            for k in range(-first % every, len(rows), every):
                at = recorder.time(start + first + k)
                recorder.add_transforms(at, poses.at(states[k], at))
            total = recorder.add_steps(index, first, taken, total, _inner(subject, taken))
            states[0], rows = states[len(rows)], []
    recorder.end_episode(index=index, seed=seed, steps=steps, total=total, terminated=terminated, first=start)
    return Played(seed, steps, total)


def _steps(
    rows: list[tuple[Any, ...]],
    states: NDArray[np.float64],
    simulation: Simulation,
    following: NDArray[np.float32],
    **ends: bool,
) -> Steps:
    """Rows of observation, action, reward and info as columns; a control is what the simulator holds after its step."""
    observations, actions, rewards, infos = zip(*rows, strict=True)
    parts = named_parts(simulation, states)
    physics = {name: part[1:] if name == "control" else part[:-1] for name, part in parts.items()}
    terms = [reward_terms(info) for info in infos]
    return Steps(np.stack(observations), np.stack(actions), rewards, terms, states[:-1], physics, following, **ends)


@torch.no_grad()
def _inner(subject: Subject, steps: Steps) -> dict[str, NDArray[Any]]:
    """What the policy makes of the observations on the way, and what the critics think of the actions."""
    observation = torch.from_numpy(steps.observation)
    found = subject.policy.trace(observation)
    if subject.value is not None:
        found = found | {"value": subject.value(observation, torch.from_numpy(steps.action).clamp(-1.0, 1.0))}
    return {name: tensor.numpy() for name, tensor in found.items()}
