"""A training run in progress: what it has spent, what it writes, when it stops."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, NotRequired, Protocol, TypedDict

import numpy as np

from transferkit.budget import Spent
from transferkit.errors import InterruptedRunError, NotFiniteError
from transferkit.reading import Count, FormatError, typed
from transferkit.run.result import Best
from transferkit.run.scalars import ScalarLog
from transferkit.run.stop_signals import StopRequest, stop_signals
from transferkit.run.tables import EpisodeRow, EvaluationRow

if TYPE_CHECKING:
    from transferkit.budget import Budget
    from transferkit.run.directory import RunDirectory

RECENT = 50
"""Episodes in the running mean that progress shows; the paper's window."""

Scores = Mapping[str, float]
"""Mean, deviation and interval of an evaluation's returns, and its number of episodes, by column."""

SCORES = EvaluationRow.columns()[3:8]
"""Their names."""

LATEST = 5
"""Training episodes whose mean return says how good the learner is."""

State = TypedDict(
    "State",
    {
        "spent": tuple[Count, Count, float],
        "return": list[float],
        "length": list[Count],
        "recent": list[float],
        "peak": NotRequired[list[float]],
        "evaluated": Count,
        "evaluations": Count,
        "scores": NotRequired[dict[str, float]],
        "evaluation_steps": NotRequired[Count],
        "best": NotRequired[list[Best]],
    },
)
"""What a checkpoint says of a session; older ones have no scores, and evaluate their last step again."""


class Evaluated(Protocol):
    """What an evaluation comes to."""

    @property
    def steps(self) -> int:
        """Environment steps that it took."""
        ...

    def scores(self) -> Scores:
        """What its row says."""
        ...


Report = Callable[[Spent, Mapping[str, float]], None]
"""Called after every update with what is spent and the latest metrics, for a progress bar."""


@dataclass(frozen=True)
class Schedule:
    """When a session evaluates, stops and writes checkpoints."""

    eval_every: int = 0
    """Environment steps between evaluations; 0 for none during training."""
    stop_at: float | None = None
    """Mean return of an evaluation, after the first one, that ends training."""
    checkpoint_seconds: float = 20.0


class Session:
    """Counts experience against the budget, writes rows and checkpoints, and ends the run exactly when the budget does."""

    def __init__(
        self,
        directory: RunDirectory,
        budget: Budget,
        num_envs: int,
        *,
        evaluate: Callable[[Session], Evaluated],
        keep_best: Callable[[Session], None] = lambda _: None,
        schedule: Schedule | None = None,
        report: Report | None = None,
        charged: Spent | None = None,
        to_beat: float | None = None,
        leeway: float = 0.0,
        falls_back: bool = False,
        keeps_peak: bool = False,
    ) -> None:
        """Start with what was `charged` before training; it counts as spent, and the trainer knows nothing of it.

        `to_beat` is the mean return below which the learner is behind, and seems so if it is further below than its `leeway`;
        one that `falls_back` is then stood in for. One that `keeps_peak` is known by its best stretch of training, not by
        the latest.
        """
        self.directory, self.budget, self.spent = directory, budget, Spent() if charged is None else charged
        self._charged, self._left = replace(self.spent), budget.without(self.spent)
        self._to_beat, self._leeway, self._falls_back, self.keeps_peak = to_beat, leeway, falls_back, keeps_peak
        self.peak: float | None = None
        self._evaluate, self._keep_best, self.schedule, self._report = evaluate, keep_best, schedule or Schedule(), report
        self._return, self._length = [0.0] * num_envs, [0] * num_envs
        self._recent: deque[float] = deque(maxlen=RECENT)
        self._evaluated = self.evaluations = self.evaluation_steps = 0
        self.best: Best | None = None
        self._scores: Scores = {}
        self._stop = StopRequest()
        self._started = self._saved = 0.0
        self._seconds_before = self.spent.seconds
        self._log: ScalarLog

    @property
    def trained(self) -> Spent:
        """What is spent on training."""
        return self.spent.since(self._charged)

    @property
    def latest_return(self) -> float | None:
        """Mean return of the latest training episodes, noise and all; None before there are enough."""
        latest = self._latest
        return float(np.mean(latest)) if len(latest) == LATEST else None

    @property
    def kept_return(self) -> float | None:
        """Mean return of the training episodes by which the policy is known that the run would end with."""
        return self.peak if self.keeps_peak else self.latest_return

    @property
    def is_at_peak(self) -> bool:
        """Whether no training episodes were better than the latest ones."""
        return self.peak is None or self.latest_return == self.peak

    @property
    def surpasses(self) -> bool:
        """Whether an episode that lasts is better already than each of the latest; true before there are enough of these."""
        return self.peak is None or max(self._return) > max(self._latest)

    @property
    def is_behind(self) -> bool:
        """Whether there is a return to beat that the latest training episodes do not reach."""
        return self._is_below(self.latest_return)

    @property
    def seems_behind(self) -> bool | None:
        """Whether the latest one to five are below it by more than the leeway; before the first, too. None if there is none."""
        if self._to_beat is None:
            return None
        latest = self._latest
        return not latest or float(np.mean(latest)) < self._to_beat - self._leeway

    @property
    def plays_core(self) -> bool:
        """Whether the untrained core stands in for what is learnt."""
        return self._falls_back and self._is_below(self.kept_return)

    @property
    def progress(self) -> float:
        """Share of the budget that is spent; 1 once an evaluation was good enough to stop."""
        return 1.0 if self._good_enough else self.trained.fraction(self._left)

    @property
    def step_progress(self) -> float:
        """Share of the budget's steps that is spent; of the budget, if it does not limit them."""
        return self.trained.step_fraction(self._left)

    def count(self, index: int, reward: float, *, terminated: bool, truncated: bool) -> bool:
        """Book one step of one environment; True once the budget is reached."""
        spent = self.spent
        spent.steps += 1
        spent.seconds = self._seconds_before + time.monotonic() - self._started
        self._return[index] += float(reward)
        self._length[index] += 1
        if terminated or truncated:
            self._end_episode(index, terminated=terminated)
        return spent.exhausts(self.budget)

    def after_update(self, metrics: Mapping[str, float], state: Callable[[], Mapping[str, Any]]) -> None:
        """Check and log an update; evaluate and write a checkpoint if one is due.

        Raises:
            NotFiniteError: a metric is NaN or infinite; the last checkpoint stays.
            InterruptedRunError: a signal came; the checkpoint is written.
        """
        self._check_finite(metrics)
        if self._recent:
            metrics = {**metrics, "recent_return": float(np.mean(self._recent))}
        self._add_scalars(metrics)
        if self._evaluation_is_due:
            self.evaluate()
        if self._report is not None:
            self._report(self.spent, metrics)
        if self._stop.made or time.monotonic() - self._saved >= self.schedule.checkpoint_seconds:
            self.checkpoint(state())
        if self._stop.made:
            raise InterruptedRunError(
                f"stopped at episode {self.spent.episodes}, step {self.spent.steps}; everything is in {self.directory.path}",
                remedy="the same call goes on with {resume=True}",
            )

    def evaluate(self) -> Scores:
        """Evaluate the policy, off the clock, write the row and keep the best; not twice at the same step."""
        if self._scores and self._evaluated == self.spent.steps:
            return self._scores
        spent = self.spent
        with self._paused():
            evaluated = self._evaluate(self)
            scores = evaluated.scores()
            core = int(self.plays_core)
            self.directory.append(EvaluationRow(spent.episodes, spent.steps, round(spent.seconds, 3), **scores, core=core))
            self._add_scalars({f"evaluation/{name}": value for name, value in scores.items()})
            if self.schedule.eval_every and (self.best is None or scores["return_mean"] > self.best.return_mean):
                self.best = Best(spent.steps, scores["return_mean"])
                self._keep_best(self)
                self._saved = -np.inf  # the next checkpoint names it
        self._evaluated, self._scores = spent.steps, scores
        self.evaluations += 1
        self.evaluation_steps += evaluated.steps
        return scores

    def checkpoint(self, state: Mapping[str, Any]) -> None:
        """Write the state of the trainer and of its environments with the session's own."""
        own = {
            "spent": [self.spent.episodes, self.spent.steps, self.spent.seconds],
            "return": list(self._return),
            "length": list(self._length),
            "recent": list(self._recent),
            "peak": [] if self.peak is None else [self.peak],
            "evaluated": self._evaluated,
            "evaluations": self.evaluations,
            "scores": dict(self._scores),
            "evaluation_steps": self.evaluation_steps,
            "best": [] if self.best is None else [asdict(self.best)],
        }
        self.directory.checkpoint({"session": own, **state})
        self._saved = time.monotonic()

    def restore(self, data: object) -> None:
        """Go on from a checkpoint's `session` state.

        Raises:
            FormatError: it is not the state of such a session.
        """
        state = typed(data, State)
        scores = state.get("scores", {})
        if not len(state["return"]) == len(state["length"]) == len(self._return) or set(scores) not in (set(), {*SCORES}):
            raise FormatError("it is the state of another session")
        self.spent = Spent(*state["spent"])
        self._seconds_before = self.spent.seconds
        self._return, self._length = list(map(float, state["return"])), list(map(int, state["length"]))
        self._recent.extend(state["recent"])
        self.peak = next(iter(state.get("peak", [])), None)
        self._evaluated, self.evaluations = state["evaluated"], state["evaluations"]
        self._scores, self.evaluation_steps = scores, state.get("evaluation_steps", 0)
        self.best = next(iter(state.get("best", [])), None)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Start the clock; Ctrl-C and SIGTERM stop cleanly at the next update, a second one at once."""
        with stop_signals() as self._stop, closing(ScalarLog(self.directory.path, self.spent.steps)) as self._log:
            self._started = self._saved = time.monotonic()
            yield

    @property
    def _latest(self) -> list[float]:
        return [*self._recent][-LATEST:]

    @property
    def _good_enough(self) -> bool:
        stop_at = self.schedule.stop_at
        trained = self._evaluated > self._charged.steps
        return stop_at is not None and trained and self._scores.get("return_mean", -np.inf) >= stop_at

    @property
    def _evaluation_is_due(self) -> bool:
        every = self.schedule.eval_every
        return bool(every) and self.spent.steps // every > self._evaluated // every

    def _end_episode(self, index: int, *, terminated: bool) -> None:
        spent, total = self.spent, self._return[index]
        spent.episodes += 1
        self._recent.append(total)
        if (latest := self.latest_return) is not None:
            self.peak = latest if self.peak is None else max(latest, self.peak)
        length, seconds = self._length[index], round(spent.seconds, 3)
        self.directory.append(EpisodeRow(spent.episodes, index, total, length, int(terminated), spent.steps, seconds))
        self._return[index], self._length[index] = 0.0, 0

    def _is_below(self, mean: float | None) -> bool:
        return self._to_beat is not None and (mean is None or mean < self._to_beat)

    def _check_finite(self, metrics: Mapping[str, float]) -> None:
        for name, value in metrics.items():
            if not np.isfinite(value):
                raise NotFiniteError(
                    f"{name} became {value} at environment step {self.spent.steps}; the last good checkpoint in "
                    f"{self.directory.path} is kept",
                    remedy="lower the learning rate and train into another {out}",
                )

    def _add_scalars(self, scalars: Mapping[str, float]) -> None:
        self._log.add(scalars, self.spent.steps)

    @contextmanager
    def _paused(self) -> Iterator[None]:
        before = time.monotonic()
        yield
        self._started += time.monotonic() - before
