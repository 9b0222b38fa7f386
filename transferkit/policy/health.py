"""Signs of a policy that cannot learn, measured before training."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
import torch
from numpy.typing import NDArray

from transferkit.config.checks import AT_LEAST_ONE, check_kind, check_value
from transferkit.envs import dims_of, name_of, opened, rollout
from transferkit.errors import ConfigError
from transferkit.nn import MLP, gaussian
from transferkit.policy.base import Policy
from transferkit.streams import Streams

if TYPE_CHECKING:
    from transferkit.envs import Actor, EnvLike

DEAD = 1e-6
"""Least spread of a unit that counts as alive."""

REACH = 2.0
"""Standard deviations that exploration goes away from the mean action."""


@dataclass(frozen=True)
class Health:
    """What `health` measured, on observations of random play unless it says otherwise."""

    dead_units: float
    """Share of hidden units whose output never varies."""
    action_rank: int
    """Directions in which the mean action varies; at most act_dim."""
    act_dim: int
    std_low: float
    """Smallest standard deviation of any action on any observation."""
    std_high: float
    """Largest."""
    core_gradient: float
    """Norm of a policy gradient in the core's parameters (without a core, the network's)."""
    saturated: float
    """Share of the mean actions of its own play so far outside the limits that exploration does not reach back inside."""

    @property
    def warnings(self) -> list[str]:
        """What is wrong, in words; empty for a healthy policy."""
        low, high = self.std_low, self.std_high
        signs = {
            f"{self.dead_units:.0%} of the hidden units are dead": self.dead_units > 0.5,
            f"actions vary in {self.action_rank} of {self.act_dim} directions": self.action_rank < self.act_dim,
            f"initial standard deviation of actions spans {low:.1e} to {high:.1e}": not 0.01 <= low <= high <= 3.0,
            "no gradient reaches the core": self.core_gradient == 0.0,
            f"{self.saturated:.0%} of its own actions are further outside the limits than exploration reaches back": (
                self.saturated > 0.5
            ),
        }
        return [text for text, holds in signs.items() if holds]


def health(policy: Policy, env: EnvLike, *, steps: int = 500, seed: int = 0) -> Health:
    """Measure a policy on observations from random play in the environment, and from its own.

    Args:
        policy: any policy of the environment's dimensions; it is not changed.
        env: in any form that `make_env` takes; the state of one that is made is lost.
        steps: observations to collect of either play.
        seed: of the play and of the sampled actions.

    Raises:
        ConfigError: no policy, one of other dimensions, or no step.
    """
    check_kind("policy", policy, Policy, "make one with wrap or scratch_policy")
    check_value("steps", steps, Annotated[int, AT_LEAST_ONE])
    if not {"core", "network"} & policy.parts().keys():
        raise ConfigError(f"a {type(policy).__name__} has no network to measure", remedy="make one with wrap or scratch_policy")
    policy.check_fits(dims_of(env), env if isinstance(env, str) else name_of(env))
    device = next(policy.parameters()).device
    observation = torch.from_numpy(play(env, steps, seed)).to(device)
    outputs: list[torch.Tensor] = []
    hooks = [
        layer.register_forward_hook(lambda _m, _i, out: outputs.append(out.detach()))
        for module in policy.modules()
        if isinstance(module, MLP)
        for layer in module.activations
    ]
    mean, log_std = policy(observation)
    for hook in hooks:
        hook.remove()
    if not torch.isfinite(mean).all():
        raise ConfigError("the policy answers NaN or infinity", remedy="check its match and its weights")
    spread = torch.cat([output.std(0) for output in outputs])
    std = log_std.detach().exp()
    return Health(
        dead_units=float((spread < DEAD).float().mean()),
        action_rank=_rank(mean.detach()),
        act_dim=policy.act_dim,
        std_low=float(std.min()),
        std_high=float(std.max()),
        core_gradient=_core_gradient(policy, mean, log_std, seed),
        saturated=_saturated(policy, torch.from_numpy(play(env, steps, seed, policy)).to(device)),
    )


def play(env: EnvLike, steps: int, seed: int, policy: Actor | None = None) -> NDArray[np.float32]:
    """Collect observations `(steps, obs_dim)` under the policy's mean actions; without one under uniform actions."""
    streams = Streams(seed)
    observations: list[NDArray[np.float32]] = []
    with opened(env) as made:
        actor = policy or _Uniform(made.action_space.shape or (), streams.numpy("health actions"))
        # Seeded by what has been seen so far, so that longer play begins like shorter play.
        transitions = rollout(actor, [made], lambda _: streams.integer("health", len(observations)))
        for step in itertools.islice(transitions, steps):
            observations.append(step.observation)  # noqa: PERF401 - the seeds read its length meanwhile
    return np.stack(observations)


@dataclass(frozen=True)
class _Uniform:
    shape: tuple[int, ...]
    generator: np.random.Generator

    def act(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.stack([self.generator.uniform(-1, 1, self.shape).astype(np.float32) for _ in observation])


@torch.no_grad()
def _saturated(policy: Policy, observation: torch.Tensor) -> float:
    mean, log_std = policy(observation)
    return float((mean.abs() - REACH * log_std.exp() > 1).float().mean())


def _core_gradient(policy: Policy, mean: torch.Tensor, log_std: torch.Tensor, seed: int) -> float:
    parts = policy.parts()
    part = parts.get("core", parts.get("network"))
    assert isinstance(part, torch.nn.Module)
    parameters = [parameter for parameter in part.parameters() if parameter.requires_grad]
    if not parameters:
        return 0.0
    noise = torch.randn(mean.shape, generator=Streams(seed).torch("health"), device="cpu").to(mean.device)
    action = (mean + log_std.exp() * noise).detach()
    # Weighted as if the first action were the advantage; unweighted, the expected gradient is zero.
    loss = (gaussian.log_prob(mean, log_std, action) * action[:, 0]).mean()
    gradients = torch.autograd.grad(loss, parameters, allow_unused=True)
    return float(sum(float(gradient.norm()) ** 2 for gradient in gradients if gradient is not None) ** 0.5)


def _rank(actions: torch.Tensor) -> int:
    values = torch.linalg.svdvals(actions - actions.mean(0))
    return int((values > 1e-4 * values[0].clamp(min=1e-12)).sum()) if values[0] > 1e-9 else 0
