"""The training loop of DYNA-DDPG."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch

from transferkit.config import DynaConfig
from transferkit.dyna.agent import Agent
from transferkit.dyna.diagnostics import EVERY, diagnose
from transferkit.dyna.replay import Batch
from transferkit.envs.vector import VectorEnv
from transferkit.errors import DivergedError
from transferkit.nn.critic import Critic
from transferkit.nn.dynamics import Dynamics
from transferkit.policy.base import Policy
from transferkit.run.session import Session
from transferkit.run.streams import Streams

EXCESS = 10.0
"""A value this many times the largest possible return has diverged."""

LOG_EVERY = 100
"""Environment steps between looks at losses, signals and the clock of checkpoints."""


def train(
    policy: Policy,
    critic: Critic,
    model: Dynamics,
    envs: VectorEnv,
    config: DynaConfig,
    session: Session,
    streams: Streams,
    device: torch.device,
    resume_from: Mapping[str, Any] | None = None,
    *,
    prior: Batch | None = None,
) -> dict[str, Critic | Dynamics]:
    """Train the policy, its critic and its model in place until the session's budget is reached.

    `prior` are transitions `(N, ...)` made elsewhere, which are learnt from as from those of this run.
    Returns the critic, and the model if it was fitted.

    Raises:
        NotFiniteError: NaN from an environment or in a loss.
        DivergedError: the critic's values are beyond anything the rewards allow.
        Interrupted: a signal came; the state is on disk.
    """
    agent = Agent(policy.to(device), critic.to(device), model.to(device), config, streams, device)
    agent.set_progress(session.progress, session.step_progress)
    if resume_from is None:
        if prior is not None:
            agent.remember(prior)
        observation = envs.reset()
    else:
        agent.restore(dict(resume_from["agent"]))
        observation = envs.restore(resume_from["envs"])
    while session.progress < 1:
        action = agent.explore(observation)
        step = envs.step(action, session.count)
        agent.observe(observation, action, step)
        observation = step.observation
        if session.spent.steps % EVERY == 0 and agent.fitted and agent.needs_model:
            session.directory.append("model", {"steps": session.spent.steps, **diagnose(model, agent.buffer)})
        agent.learn()
        if session.spent.steps % LOG_EVERY == 0:
            agent.set_progress(session.progress, session.step_progress)
            _check_values(agent, session)
            session.after_update(agent.metrics(), lambda: {"agent": agent.state(), "envs": envs.state()})
    return {"critic": critic, **({"dynamics": model} if agent.fitted else {})}


def _check_values(agent: Agent, session: Session) -> None:
    value = abs(agent.metrics().get("value", 0.0))
    bound = EXCESS * agent.largest_return
    if value > bound:
        raise DivergedError(
            f"the critic's mean value is {value:.3g} at environment step {session.spent.steps}, over {EXCESS:g} times what the "
            f"rewards allow; the last good checkpoint in {session.directory.path} is kept: train into another --out DIR with a "
            "lower --dyna.critic-learning-rate or fewer --dyna.updates-per-step"
        )
