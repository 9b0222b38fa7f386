"""The training loop, and what it needs of a trainer."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from torch import nn

from transferkit.files import damaged_run
from transferkit.run import CHECKPOINT, check_alike

if TYPE_CHECKING:
    from transferkit.envs import VectorEnv
    from transferkit.run import Scores, Session

Observation = NDArray[np.float32]
"""What the next actions are chosen from, `(num_envs, obs_dim)`."""

Metrics = Mapping[str, float]


class Trainer(Protocol):
    """An algorithm that improves a policy in place, step by step or rollout by rollout."""

    num_envs: int
    """Environments that it steps side by side."""
    overrun_steps: int
    """First steps in which an ended episode goes on; 0 but for the paper's DYNA-DDPG."""
    hold: int
    """Control steps for which the environments hold an action."""

    def advance(self, envs: VectorEnv, observation: Observation, session: Session) -> tuple[Observation, Metrics | None]:
        """Take experience, counted by the session, and learn from it.

        Returns the observation to go on from, and metrics after an update that is worth a look at the clock.
        """
        ...

    def state(self) -> dict[str, Any]:
        """Return everything that the next `advance` depends on, besides the environments."""
        ...

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        ...

    def trained(self) -> dict[str, nn.Module]:
        """Return what was trained beside the policy, by name."""
        ...


def run_loop(trainer: Trainer, envs: VectorEnv, session: Session, checkpoint: Mapping[str, Any] | None = None) -> None:
    """Train until the session's budget is reached, from a checkpoint if there is one.

    Raises:
        NotFiniteError: NaN from an environment or in a loss.
        DivergedError: values are beyond anything that the rewards allow.
        InterruptedRunError: a signal came; the state is on disk.
    """
    if checkpoint is None:
        observation = envs.reset()
    else:
        with damaged_run(session.directory.path / CHECKPOINT):
            check_alike(checkpoint["trainer"], trainer.state())
            trainer.restore(checkpoint["trainer"])
            observation = envs.restore(checkpoint["envs"])
    while session.progress < 1:
        observation, metrics = trainer.advance(envs, observation, session)
        if metrics is not None:
            session.after_update(metrics, lambda: {"trainer": trainer.state(), "envs": envs.state()})


def train_and_evaluate(
    trainer: Trainer, envs: VectorEnv, session: Session, checkpoint: Mapping[str, Any] | None = None
) -> Scores:
    """Run the loop within its session, with an evaluation after it and, if some are due during training, before it.

    The state after the last evaluation is kept: a finished run goes on from it if it is given more budget.
    """
    if checkpoint is not None:
        with damaged_run(session.directory.path / CHECKPOINT):
            checkpoint = migrated_checkpoint(checkpoint)
            session.restore(checkpoint["session"])
    with session.running(), closing(envs):
        if checkpoint is None and session.schedule.eval_every:
            session.evaluate()  # before any training: the jumpstart
        run_loop(trainer, envs, session, checkpoint)
        scores = session.evaluate()
        session.checkpoint({"trainer": trainer.state(), "envs": envs.state()})
        return scores


def migrated_checkpoint(checkpoint: Mapping[str, Any]) -> dict[str, Any]:
    """Bring a checkpoint into today's form: until version 0.2 the environments' state lay in the trainer's, under its name."""
    if "envs" in checkpoint:
        return dict(checkpoint)
    within = dict(checkpoint["trainer"])
    envs, (own,) = within.pop("envs"), within.values()
    return {**checkpoint, "trainer": own, "envs": envs}
