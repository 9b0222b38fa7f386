"""The format of recordings: topics, JSON schemas with one named field per element, and the metadata that explains them.

Times are simulated: the steps since the start of the file times the control time step, in nanoseconds.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import msgspec

from transferkit.reading import Count, parse, sealed, typed, unsealed
from transferkit.spec import IOSpec

T = TypeVar("T")

VERSION = "1"
"""Version of this format."""

STEP = "/step"
"""One JSON message a step: a single topic, because what a message costs hardly depends on its size."""

SCENE, TRANSFORMS = "/scene", "/tf"
"""Foxglove's protobuf messages for the 3D scene."""

ABOUT, EPISODE = "transferkit", "episode"
"""Names of the metadata records: one about the file, at its start, and one after every whole episode."""

SCENE_HZ = 30.0
"""The most transforms a second of simulated time."""


@dataclass(frozen=True)
class About:
    """The metadata about a file; more than these is for people."""

    spec: IOSpec
    seed: Count
    versions: dict[str, str]
    clip_actions: bool
    episodes: Count | None = None
    """How many it was to hold."""
    max_episode_steps: Count | None = None

    @property
    def rules(self) -> dict[str, Any]:
        """Those of `make_env` under which it was recorded."""
        return {"clip_actions": self.clip_actions, "max_episode_steps": self.max_episode_steps}


@dataclass(frozen=True)
class Ended:
    """The metadata of an episode that is whole; more than these is for people."""

    index: Count
    steps: Count


class Step(msgspec.Struct, rename={"return_": "return"}):
    """A message of the topic `/step`, as it is read."""

    episode: Count
    step: Count
    observation: dict[str, float]
    action: dict[str, float]
    reward: float
    terminated: bool
    truncated: bool
    return_: float = 0.0
    control: dict[str, float] = {}
    core_input: dict[str, float] = {}
    core_output: dict[str, float] = {}
    value: float | None = None
    next_observation: dict[str, float] | None = None
    """Only where an episode ends."""
    state: str = ""

    @property
    def ended(self) -> bool:
        """Whether the episode ended with it."""
        return self.terminated or self.truncated

    def precedes(self, other: Step) -> bool:
        """Whether the other one is the next of the same episode."""
        return (other.episode, other.step) == (self.episode, self.step + 1)


@dataclass(frozen=True)
class Names:
    """Names of the elements of every vector that is recorded, in order."""

    observation: Sequence[str]
    action: Sequence[str]
    core_input: Sequence[str] = ()
    core_output: Sequence[str] = ()

    @classmethod
    def of(cls, spec: IOSpec, core_input: Sequence[str] = (), core_output: Sequence[str] = ()) -> Names:
        """Take the spec's names, made distinct if an environment repeats one."""
        return cls(
            distinct([element.name for element in spec.observation]),
            distinct([actuator.name for actuator in spec.action]),
            distinct(core_input),
            distinct(core_output),
        )


def distinct(names: Sequence[str]) -> list[str]:
    """Make plain words of names, which message paths of plotting tools can hold; those that occur twice get their index."""
    plain = [re.sub(r"\W+", "_", name).strip("_") for name in names]
    count = Counter(plain)
    once = [name if count[name] == 1 else f"{name}_{i}" for i, name in enumerate(plain)]
    return once if len(set(once)) == len(once) else [f"{name}_{i}" for i, name in enumerate(plain)]


def schema(names: Names) -> dict[str, Any]:
    """Make the JSON schema of a step."""
    number, flag, whole = {"type": "number"}, {"type": "boolean"}, {"type": "integer"}
    free = {"type": "object", "additionalProperties": number}

    def vector(elements: Sequence[str]) -> dict[str, Any]:
        return {"type": "object", "properties": dict.fromkeys(elements, number)}

    properties = {
        "episode": whole,
        "step": whole,
        "observation": vector(names.observation),
        "core_input": vector(names.core_input),
        "core_output": vector(names.core_output),
        "action": vector(names.action),
        "control": free,
        "value": number,
        "reward": number,
        "return": number,
        "reward_terms": free,
        "terminated": flag,
        "truncated": flag,
        "next_observation": vector(names.observation),
        "time": number,
        "qpos": free,
        "qvel": free,
        "state": {"type": "string", "contentEncoding": "base64"},
    }
    return {"type": "object", "title": "transferkit.Step", "properties": properties}


def about(spec: IOSpec, **more: object) -> dict[str, str]:
    """Make the metadata about a file."""
    return as_metadata({"format": VERSION, "env": spec.env_id, "spec": spec.to_json(), **more})


def as_metadata(content: Mapping[str, Any]) -> dict[str, str]:
    """Write values as JSON, because MCAP's are strings, with a digest of all of them."""
    return {name: json.dumps(value, allow_nan=False) for name, value in sealed(content).items()}


def from_metadata(metadata: Mapping[str, str], kind: type[T]) -> T:
    """Read what `as_metadata` made; earlier versions wrote no digest.

    Raises:
        FormatError: it is damaged.
    """
    return typed(unsealed({name: parse(value, object) for name, value in metadata.items()}), kind)
