"""Settings of PPO."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from transferkit.config.names import Preset, check_choices
from transferkit.errors import ConfigError

LONGEST_ROLLOUT, LONGEST_SHARE, MOST_MINIBATCHES = 2048, 0.05, 8
"""Of an adaptive rollout: the steps and the share of the budget after which it waits no more, and gradient steps of a pass."""

ADAPTIVE_RATES = (1e-5, 1e-2)
"""Between which rsl_rl keeps a learning rate that follows the KL divergence."""


@dataclass(frozen=True)
class PPOConfig:
    """Proximal policy optimisation (Schulman et al. 2017); defaults tuned on Gymnasium's MuJoCo tasks and cart-poles."""

    num_envs: int = 4
    """Environments stepped side by side."""
    rollout: Literal["adaptive", "steps", "episode"] = "adaptive"
    """Update after `rollout_steps`, after every episode (the paper), or, adaptive, after `rollout_steps` in which an episode
    has ended, waiting for that no longer than 2048 steps or a twentieth of the budget."""
    rollout_steps: int = 128
    """Environment steps per update, over all environments together; the least of an adaptive rollout."""
    epochs: int = 10
    """Passes over a rollout."""
    batch_size: int = 64
    """Samples per gradient step; at least, of an adaptive rollout, which is cut evenly into 8 minibatches at most."""
    shuffle: bool = True
    """Draw minibatches at random; False takes them in the order of time."""
    learning_rate: float = 3e-4
    """Adam step size, at first; parts of a wrapped policy scale it."""
    schedule: Literal["fixed", "linear", "adaptive", "step"] = "adaptive"
    """Learning rate over the run: fixed, linear to zero, by KL divergence, or x 0.9 every 100 episodes (the paper)."""
    desired_kl: float = 0.005
    """Of the adaptive schedule, nats: above twice it, from the policy that collected the rollout, the rate falls, below half
    it rises, between 1e-5 and 1e-2."""
    critic_learning_rate: float | None = 1e-3
    """Adam step size of the critic, whatever the schedule: a new critic must not wait for a policy that may hardly move. None
    takes the policy's."""
    gamma: float = 0.99
    """Discount per step."""
    lam: float = 0.95
    """Generalised advantage estimation (Schulman et al. 2016)."""
    clip: float = 0.2
    """Range of the probability ratio."""
    value_coefficient: float = 0.5
    """Weight of the value loss."""
    entropy_coefficient: float = 0.0
    """Weight of the entropy bonus."""
    max_grad_norm: float | None = 0.5
    """Gradient norm limit of the actor and of the critic; None switches it off."""
    value_target: Literal["gae", "monte-carlo"] = "gae"
    """Regress values on the lambda return, or on the plain return of the episode."""
    bootstrap_timeouts: bool = True
    """Add the discounted value of the true final observation where the time limit cut an episode."""
    normalize_advantage: Literal["rollout", "batch"] = "rollout"
    """Standardise advantages over the rollout or over each minibatch."""
    normalize_observation: bool = True
    """Running mean and variance inside the policy."""
    normalize_reward: bool = True
    """Divide rewards by the running standard deviation of the discounted return."""
    clip_actions: bool = True
    """Clip actions to [-1, 1] before the environment sees them."""
    hidden: tuple[int, ...] = (64, 64)
    """Hidden layers of the policy that is trained from scratch, and of the critic."""
    activation: Literal["tanh", "relu", "elu"] = "tanh"
    """Activation of both."""
    std: Literal["parameter", "head"] = "parameter"
    """One bounded log-std per action, or a linear head on the features (the paper)."""
    init_std: float = 0.6
    """Initial standard deviation, of an action range of [-1, 1]."""

    @property
    def capacity(self) -> int:
        """The most steps of each environment in a rollout."""
        return (max(self.rollout_steps, LONGEST_ROLLOUT) if self.rollout == "adaptive" else self.rollout_steps) // self.num_envs

    def rollout_is_over(self, steps: int, *, ended: bool, share: float) -> bool:
        """Whether to update after this many steps and this share of the budget, in which an episode has ended or not."""
        if self.rollout == "adaptive":
            return steps >= self.rollout_steps and (ended or share >= LONGEST_SHARE)
        return ended and self.rollout == "episode"

    def minibatch_sizes(self, steps: int) -> list[int]:
        """Samples of each gradient step of a pass over a rollout of this many steps."""
        if self.rollout == "adaptive":
            count = min(MOST_MINIBATCHES, max(1, steps // self.batch_size))
            return [steps // count + (k < steps % count) for k in range(count)]
        return [min(self.batch_size, steps - start) for start in range(0, steps, self.batch_size)]

    def __post_init__(self) -> None:
        check_choices(self)
        if self.num_envs < 1 or self.rollout_steps < self.num_envs or self.batch_size < 1 or self.epochs < 1:
            raise ConfigError(
                f"num_envs={self.num_envs}, rollout_steps={self.rollout_steps}, batch_size={self.batch_size}, "
                f"epochs={self.epochs}: each must be at least 1 and rollout_steps at least num_envs"
            )
        if self.rollout == "episode" and self.num_envs != 1:
            raise ConfigError(f"rollout='episode' needs num_envs=1, not {self.num_envs}; pass --ppo.num-envs 1")
        for name in ("gamma", "lam"):
            if not 0 <= getattr(self, name) <= 1:
                raise ConfigError(f"{name}={getattr(self, name)} must lie between 0 and 1; pass --ppo.{name}")
        for name in ("learning_rate", "critic_learning_rate"):
            rate = getattr(self, name)
            if rate is not None and not 0 < rate < 1:
                raise ConfigError(f"{name}={rate} must lie between 0 and 1; pass --ppo.{name.replace('_', '-')}")
        low, high = ADAPTIVE_RATES
        if self.schedule == "adaptive" and not low <= self.learning_rate <= high:
            raise ConfigError(
                f"learning_rate={self.learning_rate} must lie between {low:g} and {high:g} where it follows the KL divergence; "
                "pass --ppo.learning-rate, or --ppo.schedule linear"
            )


PPO_PRESETS: dict[Preset, PPOConfig] = {
    "default": PPOConfig(),
    "paper": PPOConfig(
        num_envs=1,
        rollout="episode",
        rollout_steps=1000,
        batch_size=32,
        shuffle=False,
        schedule="step",
        desired_kl=0.01,  # of no effect here; a part of the identity of runs that were measured
        critic_learning_rate=None,
        value_coefficient=1.0,
        max_grad_norm=None,
        value_target="monte-carlo",
        bootstrap_timeouts=False,
        normalize_observation=False,
        normalize_reward=False,
        clip_actions=False,
        hidden=(128, 128),
        activation="relu",
        std="head",
    ),
}
"""`paper` follows the PPOPT code line by line (docs: departures from the paper)."""
