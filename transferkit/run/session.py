"""A training run while it is going on: what it has spent, what it writes, when it stops."""

from __future__ import annotations

import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from transferkit.budget import Budget, Spent
from transferkit.errors import Interrupted, NotFiniteError
from transferkit.run.directory import RunDirectory

RECENT = 50
"""Episodes in the running mean that progress shows; the paper's window."""

Report = Callable[[Spent, Mapping[str, float]], None]
"""Called after every update with what is spent and the latest metrics, for a progress bar."""


class Session:
    """Counts experience against the budget, writes rows and checkpoints, and ends the run exactly where the budget does."""

    def __init__(
        self,
        directory: RunDirectory,
        budget: Budget,
        num_envs: int,
        *,
        evaluate: Callable[[Session], Mapping[str, float]],
        eval_every: int = 0,
        stop_at: float | None = None,
        checkpoint_seconds: float = 20.0,
        report: Report | None = None,
    ) -> None:
        self.directory, self.budget, self.spent = directory, budget, Spent()
        self._evaluate, self._eval_every, self._stop_at = evaluate, eval_every, stop_at
        self._checkpoint_seconds, self._report = checkpoint_seconds, report
        self._return, self._length = np.zeros(num_envs), np.zeros(num_envs, int)
        self._recent: deque[float] = deque(maxlen=RECENT)
        self._evaluated = self.evaluations = 0
        self._scores: Mapping[str, float] = {}
        self._interrupted = False
        self._started = self._saved = 0.0
        self._seconds_before = 0.0
        self._writer: Any = None

    @property
    def progress(self) -> float:
        """Share of the budget that is spent; 1 once an evaluation was good enough to stop."""
        return 1.0 if self._good_enough else self.spent.fraction(self.budget)

    @property
    def step_progress(self) -> float:
        """Share of the budget's steps that is spent; of the budget, where it does not limit them."""
        return self.spent.step_fraction(self.budget)

    def count(self, index: int, reward: float, terminated: bool, truncated: bool) -> bool:  # noqa: FBT001
        """Book one step of one environment; True once the budget is reached."""
        spent = self.spent
        spent.steps += 1
        spent.seconds = self._seconds_before + time.monotonic() - self._started
        self._return[index] += reward
        self._length[index] += 1
        if terminated or truncated:
            spent.episodes += 1
            self._recent.append(self._return[index])
            self.directory.append(
                "episodes",
                {
                    "episode": spent.episodes,
                    "env_index": index,
                    "return": float(self._return[index]),
                    "length": int(self._length[index]),
                    "terminated": int(terminated),
                    "steps": spent.steps,
                    "seconds": round(spent.seconds, 3),
                },
            )
            self._return[index], self._length[index] = 0.0, 0
        return spent.exhausts(self.budget)

    def after_update(self, metrics: Mapping[str, float], state: Callable[[], Mapping[str, Any]]) -> None:
        """Check and log an update; evaluate and write a checkpoint where one is due.

        Raises:
            NotFiniteError: a metric is NaN or infinite; the last checkpoint stays.
            Interrupted: a signal came; the checkpoint is written.
        """
        for name, value in metrics.items():
            if not np.isfinite(value):
                raise NotFiniteError(
                    f"{name} became {value} at environment step {self.spent.steps}; the last good checkpoint in "
                    f"{self.directory.path} is kept: lower the learning rate and train into another --out DIR"
                )
        recent = {"recent_return": float(np.mean(self._recent))} if self._recent else {}
        self._log({**metrics, **recent})
        if self._eval_every and self._evaluations_due():
            self.evaluate()
        if self._report is not None:
            self._report(self.spent, {**metrics, **recent})
        if self._interrupted or time.monotonic() - self._saved >= self._checkpoint_seconds:
            self.checkpoint(state())
        if self._interrupted:
            raise Interrupted(
                f"stopped at episode {self.spent.episodes}, step {self.spent.steps}; everything is saved: the same command "
                f"with --out {self.directory.path} --resume goes on"
            )

    def evaluate(self) -> Mapping[str, float]:
        """Evaluate the policy, off the clock, and write the row; at a step that has been evaluated nothing is done again."""
        if self._scores and self._evaluated == self.spent.steps:
            return self._scores
        with self._paused():
            row = {"episodes": self.spent.episodes, "steps": self.spent.steps, "seconds": round(self.spent.seconds, 3)}
            scores = self._evaluate(self)
            self.directory.append("evaluations", {**row, **scores})
            self._log({f"evaluation/{name}": value for name, value in scores.items()})
        self._evaluated, self._scores = self.spent.steps, scores
        self.evaluations += 1
        return scores

    def checkpoint(self, state: Mapping[str, Any]) -> None:
        """Write the trainer's state with the session's own."""
        own = {
            "spent": [self.spent.episodes, self.spent.steps, self.spent.seconds],
            "return": self._return.tolist(),
            "length": self._length.tolist(),
            "recent": list(self._recent),
            "evaluated": self._evaluated,
            "evaluations": self.evaluations,
            "scores": dict(self._scores),
        }
        self.directory.checkpoint({"session": own, "trainer": dict(state)})
        self._saved = time.monotonic()

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from a checkpoint's `session` state."""
        self.spent = Spent(*state["spent"])
        self._seconds_before = self.spent.seconds
        self._return, self._length = np.array(state["return"]), np.array(state["length"], int)
        self._recent.extend(state["recent"])
        self._evaluated, self.evaluations = state["evaluated"], state["evaluations"]
        self._scores = state.get("scores", {})  # older checkpoints have none, and evaluate their last step again

    @contextmanager
    def running(self) -> Iterator[None]:
        """Start the clock, and turn Ctrl-C and SIGTERM into a clean stop at the next update; a second one stops at once."""
        self._started = self._saved = time.monotonic()
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        previous = {number: signal.signal(number, self._interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)
            if self._writer is not None:
                self._writer.close()

    @property
    def _good_enough(self) -> bool:
        return self._stop_at is not None and self._evaluated > 0 and self._scores["return_mean"] >= self._stop_at

    def _evaluations_due(self) -> bool:
        return self.spent.steps // self._eval_every > self._evaluated // self._eval_every

    def _interrupt(self, number: int, frame: object) -> None:
        if self._interrupted:
            raise KeyboardInterrupt
        self._interrupted = True

    @contextmanager
    def _paused(self) -> Iterator[None]:
        before = time.monotonic()
        yield
        self._started += time.monotonic() - before

    def _log(self, scalars: Mapping[str, float]) -> None:
        if self._writer is None:
            from torch.utils.tensorboard import SummaryWriter  # noqa: PLC0415 - takes seconds to import

            with self._paused():
                self._writer = SummaryWriter(str(self.directory.path / "tensorboard"), purge_step=self.spent.steps)
        for name, value in scalars.items():
            self._writer.add_scalar(name, value, self.spent.steps)
