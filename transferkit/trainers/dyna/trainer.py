"""DYNA-DDPG as a trainer."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from numpy.typing import NDArray
from torch import nn

from transferkit.errors import DivergedError
from transferkit.policy.critic_and_model import make_critic, make_dynamics
from transferkit.trainers.dyna.agent import Agent
from transferkit.trainers.dyna.diagnostics import EVERY, diagnose
from transferkit.trainers.dyna.kept import Kept
from transferkit.trainers.dyna.replay import Batch

if TYPE_CHECKING:
    from transferkit.config import TrainConfig
    from transferkit.envs import Mirror, VectorEnv
    from transferkit.policy.base import Policy
    from transferkit.run import Session
    from transferkit.spec import IOSpec
    from transferkit.streams import Streams
    from transferkit.trainers.loop import Metrics, Observation

EXCESS = 10.0
"""A value this many times the largest possible return has diverged."""

LOG_EVERY = 100
"""Environment steps between looks at losses, signals and the clock of checkpoints."""


class DynaTrainer:
    """Advances by one environment step and the updates that follow it."""

    num_envs, hold = 1, 1  # what is held is held by the agent

    def __init__(
        self,
        policy: Policy,
        spec: IOSpec,
        config: TrainConfig,
        streams: Streams,
        device: torch.device,
        prior: Sequence[NDArray] | None = None,
        *,
        mirror: Mirror | None = None,
        compiles: bool = False,
    ) -> None:
        """Make critics, model and agent; `prior` are the arrays of a `Batch` of elsewhere, learnt from like the run's own.

        With a `mirror` it learns from images, too.
        `policy` becomes what is learnt, or what is kept of it, if the configuration asks for that.
        """
        dyna, hidden = config.dyna, config.network.hidden
        given, policy = policy.to(device), copy.deepcopy(policy) if dyna.keep_peak else policy
        self.overrun_steps = dyna.overrun_steps
        model = make_dynamics(policy, spec, config.model, streams.torch("model initialisation"), wrapped=config.wrap.dynamics)
        critic = make_critic(policy, dyna, hidden, streams.torch("critic initialisation"), wrapped=config.wrap.critic)
        policy, critic, model = policy.to(device), critic.to(device), model.to(device)
        options = {"time_step": spec.time_step, "mirror": mirror, "compiles": compiles}
        self.agent = Agent(policy, critic, model, dyna, config.model, streams, device, **options)
        self._kept = Kept(given, policy, {"critic": critic, "dynamics": model}) if dyna.keep_peak else None
        self._taken_up = True
        if prior is not None:
            self.agent.remember(Batch(*map(torch.from_numpy, prior)))
            if self._kept is not None:
                self._kept.follow(self.agent.average, self._latest())  # with what was seen

    def advance(self, envs: VectorEnv, observation: Observation, session: Session) -> tuple[Observation, Metrics | None]:
        """Take one step of the one environment and learn from it; metrics every `LOG_EVERY` steps."""
        agent = self.agent
        if self._taken_up or session.trained.steps % LOG_EVERY == 0:
            behind = session.seems_behind if agent.config.anchor_halves else session.is_behind
            agent.set_progress(session.progress, session.step_progress, behind=behind)
            self._taken_up = False
        step = envs.step(action := agent.explore(observation), session.count)
        agent.observe(observation, action, step)
        if session.trained.steps % EVERY == 0 and agent.fitted and agent.needs_model:
            session.directory.append(diagnose(agent.model, agent.buffer, session.spent.steps))
        agent.learn()
        looks = session.trained.steps % LOG_EVERY == 0
        self._keep(session, ended=bool(step.done[0]), looks=looks)
        if not looks:
            return step.observation, None
        self._check_values(session)
        return step.observation, agent.metrics()

    def state(self) -> dict[str, Any]:
        """Return everything that the next step depends on."""
        return self.agent.state() | ({} if self._kept is None else {"kept": self._kept.state()})

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        self.agent.restore(state)
        if self._kept is not None:
            self._kept.restore(state["kept"])

    def trained(self) -> dict[str, nn.Module]:
        """Return the critics, and the model if it was fitted; as they were when the policy was kept, if it was."""
        return self._latest() if self._kept is None else self._kept.trained()

    def _keep(self, session: Session, *, ended: bool, looks: bool) -> None:
        """Follow what is learnt from the best episodes on, until one that ended says that they were better."""
        if self._kept is None:
            return
        if not session.is_at_peak:
            if ended:
                self._kept.recall()
        elif ended or ((looks or session.progress >= 1) and (session.surpasses or not self.agent.config.keep_tried)):
            self._kept.follow(self.agent.average, self._latest())
            if ended:
                self._kept.remember()

    def _latest(self) -> dict[str, nn.Module]:
        agent = self.agent
        return {"critic": agent.critic, **({"dynamics": agent.model} if agent.fitted else {})}

    def _check_values(self, session: Session) -> None:
        value = abs(self.agent.metrics().get("value", 0.0))
        if value > EXCESS * self.agent.largest_return:
            raise DivergedError(
                f"the critic's mean value is {value:.3g} at environment step {session.spent.steps}, over {EXCESS:g} times what "
                f"the rewards allow; the last good checkpoint in {session.directory.path} is kept",
                remedy="train into another {out} with a lower {dyna.critic_learning_rate} or fewer {dyna.updates_per_step}",
            )
