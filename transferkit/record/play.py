"""Playing episodes with a policy and recording them."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray

from transferkit.config.checks import EPISODES, Seed, check_kind, check_value
from transferkit.envs import derive_spec, open_simulation, opened, rollout
from transferkit.errors import RecordingError, TransferkitError
from transferkit.record.format import SCENE_HZ, Names, about
from transferkit.record.scene import Transforms, scene
from transferkit.record.state import integration_state, named_parts, state_size
from transferkit.record.writer import Recorder, Steps
from transferkit.streams import Streams
from transferkit.versions import command, versions

if TYPE_CHECKING:
    from transferkit.envs import EnvLike, Simulation, Transition
    from transferkit.nn import Value
    from transferkit.policy.base import Policy

ROWS = 250
"""Steps that are encoded together; what enters and leaves the core is computed for all of them at once."""


@dataclass(frozen=True)
class Subject:
    """A policy to play, evaluate, record or export, and what is known beside it."""

    policy: Policy
    env: EnvLike
    value: Value | None = None
    clip_actions: bool = True
    max_episode_steps: int | None = None
    wrapped: bool = False
    """Whether it was wrapped onto the environment just now, and is not trained there."""
    about: Mapping[str, Any] | None = None
    """JSON values for the metadata: the core, its digest, the run."""

    @property
    def rules(self) -> dict[str, Any]:
        """Those of `make_env` under which it acts."""
        return {"clip_actions": self.clip_actions, "max_episode_steps": self.max_episode_steps}


@dataclass(frozen=True)
class Played:
    """A recorded episode."""

    seed: int
    steps: int
    total: float


def record_episodes(subject: Subject, path: str | Path, *, episodes: int = 1, seed: int = 0) -> list[Played]:
    """Play episodes with the deterministic action and write them; episode k starts as it does in an evaluation with the seed.

    Raises:
        SettingError: fewer than one episode, or a negative seed.
        RecordingError: the file exists, or the environment is not MuJoCo.
        NotFiniteError: a NaN in an observation, an action or a reward.
    """
    check_kind("subject", subject, Subject, "load it with load_subject")
    check_value("episodes", episodes, Annotated[int, EPISODES])
    check_value("seed", seed, Seed)
    spec = derive_spec(subject.env)
    names = Names.of(spec, **subject.policy.trace_names())
    more = {
        "versions": versions(),
        "seed": seed,
        "episodes": episodes,
        "command": command(),
        "hold": getattr(subject.policy, "hold", 1),  # not every actor is a policy
        **subject.rules,
        **(subject.about or {}),
    }
    with opened(subject.env, **subject.rules) as env:
        simulation = open_simulation(env)
        if simulation is None:
            raise RecordingError(
                f"{spec.env_id} is not a MuJoCo environment, whose state could be recorded", remedy="record another {env}"
            )
        with Recorder(Path(path), about(spec, **more), names, spec.time_step or 1.0) as recorder:
            tape = _Tape(recorder, subject, simulation, Streams(seed))
            for step in rollout(subject.policy, [env], tape.seed_of, episodes=episodes, on_reset=tape.begin):
                tape.add(step)
            return tape.played


def record_evaluation(subject: Subject, run: Path, steps: int) -> None:
    """Record an episode of a policy in training as `recordings/step_<N>.mcap`, in place of one that a killed process began.

    If it fails a warning is logged: training is worth more than its recording.
    """
    path = run / "recordings" / f"step_{steps}.mcap"
    try:
        path.parent.mkdir(exist_ok=True)
        path.unlink(missing_ok=True)
        record_episodes(subject, path)
    except (TransferkitError, OSError) as error:
        logging.getLogger("transferkit").warning("not recorded: %s", error)


def reward_terms(info: Mapping[str, Any]) -> dict[str, float]:
    """Pick the terms of the reward that an environment names, as Gymnasium's do."""
    return {name: float(value) for name, value in info.items() if str(name).startswith("reward_") and isinstance(value, Real)}


class _Tape:
    """Gathers the steps of an episode with the simulator's states, and hands them to the recorder in blocks."""

    def __init__(self, recorder: Recorder, subject: Subject, simulation: Simulation, streams: Streams) -> None:
        self.recorder, self.subject, self.simulation, self.streams = recorder, subject, simulation, streams
        self.played: list[Played] = []
        self._size = state_size(simulation)
        self._states = np.empty((ROWS + 1, self._size))
        self._rows: list[Transition] = []
        period = recorder.time(1)
        self._every = max(1, round(1 / (SCENE_HZ * period / 1e9))) if period else 1
        """Steps between transforms."""

    def seed_of(self, episode: int) -> int:
        """Return the seed of an evaluation's episode."""
        return self.streams.episode(episode)

    def begin(self, episode: int) -> None:
        """Start an episode, whose first state the simulator has now."""
        del episode
        self._first, self._total = self.recorder.steps, 0.0
        model, at = self.simulation.model, self.recorder.time(self._first)
        self._poses = Transforms(model)
        self.recorder.add_scene(at, scene(model, at))
        self._states[0] = integration_state(self.simulation, self._size)

    def add(self, step: Transition) -> None:
        """Note a step, and the state that it led to."""
        self._rows.append(step)
        self._states[len(self._rows)] = integration_state(self.simulation, self._size)
        if step.done or len(self._rows) == ROWS:
            self._write(step)
        if step.done:
            self._end(step)

    def _write(self, last: Transition) -> None:
        states = self._states[: len(self._rows) + 1]
        first = last.step + 1 - len(self._rows)
        for k in range(-first % self._every, len(self._rows), self._every):
            at = self.recorder.time(self._first + first + k)
            self.recorder.add_transforms(at, self._poses.at(states[k], at))
        steps = _steps(self._rows, states, self.simulation)
        self._total = self.recorder.add_steps(last.episode, first, steps, self._total, _inner(self.subject, steps))
        self._states[0], self._rows = states[-1], []

    def _end(self, last: Transition) -> None:
        seed, steps = self.seed_of(last.episode), last.step + 1
        self.recorder.end_episode(
            index=last.episode, seed=seed, steps=steps, total=self._total, terminated=last.terminated, first=self._first
        )
        self.played.append(Played(seed, steps, self._total))


def _steps(rows: Sequence[Transition], states: NDArray[np.float64], simulation: Simulation) -> Steps:
    """Turn transitions into columns; a control is what the simulator holds after its step."""
    parts, last = named_parts(simulation, states), rows[-1]
    physics = {name: part[1:] if name == "control" else part[:-1] for name, part in parts.items()}
    return Steps(
        np.stack([row.observation for row in rows]),
        np.stack([row.action for row in rows]),
        [row.reward for row in rows],
        [reward_terms(row.info) for row in rows],
        states[:-1],
        physics,
        last.next_observation,
        terminated=last.terminated,
        truncated=last.truncated,
    )


@torch.no_grad()
def _inner(subject: Subject, steps: Steps) -> dict[str, NDArray[Any]]:
    """Compute what the policy makes of the observations on the way, and what the critics think of the actions."""
    observation = torch.from_numpy(steps.observation)
    inner = subject.policy.trace(observation)
    if subject.value is not None:
        inner = inner | {"value": subject.value(observation, torch.from_numpy(steps.action).clamp(-1.0, 1.0))}
    return {name: tensor.numpy() for name, tensor in inner.items()}
