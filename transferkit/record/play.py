"""Playing episodes with a policy and recording them."""

# pyright: reportAttributeAccessIssue=false
# mujoco's names come from a compiled module that pyright cannot read.
from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import torch
from numpy.typing import NDArray

from transferkit.envs import derive_spec, make_env
from transferkit.envs.access import Simulation, open_simulation
from transferkit.errors import RecordingError, TransferkitError
from transferkit.nn import Critic
from transferkit.policy import Policy
from transferkit.record.format import SCENE, SCENE_HZ, TRANSFORMS, Names, about
from transferkit.record.scene import Transforms, scene
from transferkit.record.writer import Recorder, Row
from transferkit.run.streams import Streams
from transferkit.versions import command, versions

ROWS = 250
"""Steps that are encoded together; what lies between the core's ends is computed for all of them at once."""

FULL_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)


@dataclass(frozen=True)
class Subject:
    """What is recorded: a policy, and whatever is known beside it."""

    policy: Policy
    env: str | Callable[[], gymnasium.Env]
    critic: Critic | None = None
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
    env = _make(subject)
    spec = derive_spec(subject.env if isinstance(subject.env, str) else env)
    simulation = open_simulation(env)
    if simulation is None:
        raise RecordingError(f"{spec.env_id} is no MuJoCo environment, whose state could be recorded; record another --env")
    names = Names.of(spec, **subject.policy.trace_names())
    more = {
        "versions": versions(),
        "seed": seed,
        "command": command(),
        "clip_actions": subject.clip_actions,
        **(subject.about or {}),
    }
    streams = Streams(seed)
    with Recorder(path, about(spec, **more), names, spec.time_step) as recorder:
        played = [_episode(recorder, subject, env, simulation, k, streams.integer("evaluation", k)) for k in range(episodes)]
    env.close()
    return played


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


def integration_state(simulation: Simulation, size: int) -> NDArray[np.float64]:
    """All that the next step depends on, `(size,)`."""
    state = np.empty(size)
    mujoco.mj_getState(simulation.model, simulation.data, state, FULL_STATE)
    return state


def state_size(simulation: Simulation) -> int:
    """Numbers in `integration_state`."""
    return mujoco.mj_stateSize(simulation.model, FULL_STATE)


def reward_terms(info: Mapping[str, Any]) -> dict[str, float]:
    """The terms of the reward that an environment names, as Gymnasium's do."""
    return {name: float(value) for name, value in info.items() if name.startswith("reward_") and np.ndim(value) == 0}


def _make(subject: Subject) -> gymnasium.Env:
    return make_env(subject.env if isinstance(subject.env, str) else subject.env(), clip_actions=subject.clip_actions)


def _episode(recorder: Recorder, subject: Subject, env: gymnasium.Env, simulation: Simulation, index: int, seed: int) -> Played:
    observation, _ = env.reset(seed=seed)
    model, data = simulation.model, simulation.data
    every = max(1, round(1 / (SCENE_HZ * recorder.time(1) / 1e9))) if recorder.time(1) else 1
    poses, size = Transforms(model), state_size(simulation)
    start, rows, total, steps = recorder.steps, [], 0.0, 0
    terminated = truncated = False
    recorder.add_protobuf(SCENE, scene(model, recorder.time(start)), recorder.time(start))
    while not (terminated or truncated):
        at = recorder.time(start + steps)
        if steps % every == 0:
            recorder.add_protobuf(TRANSFORMS, poses.at(data, at), at)
        before = data.time, data.qpos.copy(), data.qvel.copy(), integration_state(simulation, size)
        action = subject.policy.act(observation[None])[0]
        following, reward, terminated, truncated, info = env.step(action)
        step = action, data.ctrl.copy(), float(reward), reward_terms(info), bool(terminated), bool(truncated)
        rows.append(Row(observation, *step, following, *before))
        observation, steps = following, steps + 1
        if terminated or truncated or len(rows) == ROWS:
            total = recorder.add_rows(index, steps - len(rows), rows, total, _inner(subject, rows))
            rows = []
    recorder.end_episode(index=index, seed=seed, steps=steps, total=total, terminated=bool(terminated), first=start)
    return Played(seed, steps, total)


@torch.no_grad()
def _inner(subject: Subject, rows: list[Row]) -> dict[str, NDArray[Any]]:
    """What the policy makes of the observations on the way, and the critics' mean value of the actions."""
    observation = torch.from_numpy(np.stack([row.observation for row in rows]))
    found = subject.policy.trace(observation)
    if subject.critic is not None:
        action = torch.from_numpy(np.stack([row.action for row in rows])).clamp(-1.0, 1.0)
        found = found | {"value": subject.critic(observation, action).mean(0)}
    return {name: tensor.numpy() for name, tensor in found.items()}
