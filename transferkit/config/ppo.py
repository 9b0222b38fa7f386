"""Settings of PPO."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from transferkit.config.checks import AT_LEAST_ONE, BATCH, NOT_NEGATIVE, POSITIVE, RATE, SHARE, Range, check
from transferkit.errors import SettingError

ADAPTIVE_RATES = Range(1e-5, 1e-2)
"""Learning rates between which rsl_rl keeps one that follows the KL divergence."""


@dataclass(frozen=True)
class PPOConfig:
    """Proximal policy optimisation (Schulman et al. 2017); defaults tuned on Gymnasium's MuJoCo tasks and cart-poles."""

    num_envs: Annotated[int, Range(1, 1024)] = 4
    """Environments stepped side by side."""
    rollout: Literal["adaptive", "steps", "episode"] = "adaptive"
    """Update after `rollout_steps`, after every episode (the paper), or, adaptive, after `rollout_steps` in which an episode
    has ended, waiting for that no longer than 2048 actions or a twentieth of the budget."""
    rollout_steps: Annotated[int, Range(1, 1_000_000)] = 128
    """Actions per update, over all environments together; the least of an adaptive rollout."""
    least_share: Annotated[float, SHARE] = 0.0
    """Share of the budget that an adaptive rollout has at least, as far as 2048 actions go: many updates from little do not
    agree with each other."""
    epochs: Annotated[int, AT_LEAST_ONE] = 10
    """Passes over a rollout."""
    batch_size: Annotated[int, BATCH] = 64
    """Samples per gradient step; the least of an adaptive rollout, which is cut evenly into at most 8 minibatches."""
    shuffle: bool = True
    """Draw minibatches at random; False takes them in the order of time."""
    learning_rate: Annotated[float, RATE] = 3e-4
    """Adam step size at first; parts of a wrapped policy scale it."""
    schedule: Literal["fixed", "linear", "adaptive", "step"] = "adaptive"
    """Learning rate over the run: fixed, linear to zero, by KL divergence, or x 0.9 every 100 episodes (the paper)."""
    desired_kl: Annotated[float, POSITIVE] = 0.005
    """Nats, for the adaptive schedule: above twice it, from the policy that collected the rollout, the rate falls; below half
    it the rate rises, between 1e-5 and 1e-2."""
    critic_learning_rate: Annotated[float, RATE] | None = 1e-3
    """Adam step size of the critic, whatever the schedule: a new critic must not wait for a policy that may hardly move. None
    takes the policy's."""
    gamma: Annotated[float, SHARE] = 0.99
    """Discount per step."""
    lam: Annotated[float, SHARE] = 0.95
    """Generalised advantage estimation (Schulman et al. 2016)."""
    clip: Annotated[float, POSITIVE] = 0.2
    """Range of the probability ratio."""
    value_coefficient: Annotated[float, NOT_NEGATIVE] = 0.5
    """Weight of the value loss."""
    entropy_coefficient: Annotated[float, NOT_NEGATIVE] = 0.0
    """Weight of the entropy bonus."""
    max_grad_norm: Annotated[float, POSITIVE] | None = 0.5
    """Gradient norm limit of the actor and of the critic; None switches it off."""
    value_target: Literal["gae", "monte-carlo"] = "gae"
    """Regress values on the lambda return, or on the plain return of the episode."""
    bootstrap_timeouts: bool = True
    """Add the discounted value of the true final observation if the time limit cut an episode."""
    normalize_advantage: Literal["rollout", "batch"] = "rollout"
    """Standardise advantages over the rollout or over each minibatch."""
    normalize_reward: bool = True
    """Divide rewards by the running standard deviation of the discounted return."""
    critic_first: Annotated[float, SHARE] = 0.0
    """Share of the budget, at its beginning, in which only the critic learns if the policy has a core: what a critic that knows
    nothing says of it would spoil it."""

    def __post_init__(self) -> None:
        check(self, "ppo")
        if self.rollout_steps < self.num_envs:
            raise SettingError("ppo.rollout_steps", value=self.rollout_steps, allowed=f"at least ppo.num_envs={self.num_envs}")
        if self.rollout == "episode" and self.num_envs != 1:
            raise SettingError("ppo.num_envs", value=self.num_envs, allowed="1 if ppo.rollout is 'episode'")
        if self.schedule == "adaptive" and self.learning_rate not in ADAPTIVE_RATES:
            raise SettingError(
                "ppo.learning_rate",
                value=self.learning_rate,
                allowed=f"{ADAPTIVE_RATES} if it follows the KL divergence",
                remedy="or choose another {ppo.schedule=linear}",
            )
