"""What a run's JSON files hold: its record, written first, and its result, written last."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from transferkit.reading import Count
from transferkit.spec import IOSpec

RECORD, RESULT = "run.json", "result.json"


@dataclass(frozen=True)
class Earlier:
    """What a run had spent and scored when it was finished, before it was given more budget."""

    episodes: Count
    steps: Count
    seconds: float
    eval_return_mean: float
    eval_return_std: float
    eval_return_low: float
    eval_return_high: float
    eval_episodes: Count


@dataclass(frozen=True)
class Best:
    """The evaluation with the highest mean return; its policy is kept beside the final one."""

    steps: Count
    return_mean: float


@dataclass(frozen=True)
class Continuation:
    """What a finished run goes on with."""

    budget: dict[str, int | float]
    """The new limits by kind; what was spent before counts."""
    after: Earlier
    """Where it goes on from."""
    versions: dict[str, str]
    git: dict[str, Any] | None = None
    command: str = ""


@dataclass(frozen=True)
class Record:
    """What a run was started with."""

    config: dict[str, Any]
    """Its configuration, of this version or of an earlier one."""
    versions: dict[str, str]
    git: dict[str, Any] | None = None
    command: str = ""
    continuations: tuple[Continuation, ...] = ()
    """Each time that it was finished and given more budget, in order."""


@dataclass(frozen=True)
class Recording:
    """A recording that training starts with."""

    name: str
    steps: int
    sha256: str


@dataclass(frozen=True)
class Probation:
    """How a wrapped core did against doing nothing, before any training."""

    accepted: bool
    """Whether it is trained; if not, the run is one from scratch."""
    reason: str
    core: tuple[float, ...]
    """Returns of the core's episodes."""
    zero: tuple[float, ...]
    """Returns of zero action from the same starts."""
    episodes: Count
    """What it cost, of the run's budget: episodes of both."""
    steps: Count
    seconds: float


@dataclass(frozen=True)
class MadeOf:
    """What the configuration in the record of a training run has beside its settings."""

    policy: dict[str, Any]
    """The policy's blueprint."""
    core_digest: str | None = None
    compiled: bool = False
    """Whether the trainer's updates were compiled."""
    recordings: tuple[Recording, ...] = ()
    spec: IOSpec | None = None
    """What the environment's numbers mean, where no id makes it again."""
    probation: Probation | None = None
    """What was found of the core before training, where it was asked."""


@dataclass(frozen=True)
class Result:
    """The outcome of a finished training run."""

    algo: str
    preset: str
    core: str | None
    core_digest: str | None
    member: int | None
    env: str
    seed: int
    episodes: int
    """Completed training episodes."""
    steps: int
    """Environment steps of training."""
    seconds: float
    """Seconds of training, evaluation not counted."""
    eval_return_mean: float
    eval_return_std: float
    eval_return_low: float
    """Student's 95 % interval of the mean over evaluation episodes."""
    eval_return_high: float
    eval_episodes: int
    run_dir: str
    prior_steps: int = 0
    """Steps of recordings that training started with; in no other count."""
    best: Best | None = None
    """The best evaluation, of a run that is evaluated during training."""
    evaluation_steps: int = 0
    """Environment steps of all evaluations; in no other count, but whoever takes the best policy has used them."""
    probation: Probation | None = None
    """What was found of the core before training; its episodes, steps and seconds are in the counts."""
    fell_back: bool = False
    """Whether the final policy is the core as it was wrapped, because what was learnt is still behind it."""
    earlier: tuple[Earlier, ...] = ()
    """What it had spent and scored each time before it was given more budget; all other fields are of the whole run."""


@dataclass(frozen=True)
class Checksums:
    """What `result.json` has beside the result."""

    files: Mapping[str, str] = field(default_factory=dict)
    """sha256 of every table of the run; none in what earlier versions wrote."""
