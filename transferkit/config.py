"""Configuration as frozen dataclasses: one source for defaults, command-line flags and records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from transferkit.errors import ConfigError

Algorithm = Literal["ppo"]
Preset = Literal["default", "paper"]


@dataclass(frozen=True)
class PPOConfig:
    """Proximal policy optimisation (Schulman et al. 2017); defaults tuned on the Gymnasium MuJoCo tasks."""

    num_envs: int = 4
    """Environments stepped side by side."""
    rollout: Literal["steps", "episode"] = "steps"
    """Update after `rollout_steps`, or after every episode (the paper's code; one environment)."""
    rollout_steps: int = 128
    """Environment steps per update, over all environments together."""
    epochs: int = 10
    """Passes over a rollout."""
    batch_size: int = 64
    """Samples per gradient step."""
    shuffle: bool = True
    """Draw minibatches at random; False takes them in the order of time."""
    learning_rate: float = 3e-4
    """Adam step size; parts of a wrapped policy scale it."""
    schedule: Literal["fixed", "linear", "adaptive", "step"] = "linear"
    """Learning rate over the run: fixed, linear to zero, by KL divergence, or x 0.9 every 100 episodes (the paper)."""
    desired_kl: float = 0.01
    """Target of the adaptive schedule, nats."""
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

    def __post_init__(self) -> None:
        if self.num_envs < 1 or self.rollout_steps < self.num_envs or self.batch_size < 1 or self.epochs < 1:
            raise ConfigError(
                f"num_envs={self.num_envs}, rollout_steps={self.rollout_steps}, batch_size={self.batch_size}, "
                f"epochs={self.epochs}: each must be at least 1 and rollout_steps at least num_envs"
            )
        if self.rollout == "episode" and self.num_envs != 1:
            raise ConfigError(f"rollout='episode' needs num_envs=1, not {self.num_envs}; pass --ppo.num-envs 1")
        if not 0 < self.learning_rate < 1:
            raise ConfigError(f"learning_rate={self.learning_rate} must lie between 0 and 1; pass --ppo.learning-rate")


PPO_PRESETS: dict[Preset, PPOConfig] = {
    "default": PPOConfig(),
    "paper": PPOConfig(
        num_envs=1,
        rollout="episode",
        rollout_steps=1000,
        batch_size=32,
        shuffle=False,
        schedule="step",
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


@dataclass(frozen=True)
class WrapConfig:
    """How a core is built into the policy of another environment."""

    structure: Literal["default", "paper"] = "default"
    """The healthy sandwich, or the paper's with its ReLUs and its shared output layer."""
    tap: Literal["features", "action"] = "features"
    """Take the core's last hidden layer, or its action output as the paper does."""
    adapter: Literal["auto", "semantic", "random"] = "auto"
    """Fill the adapters from what the numbers mean, or at random; auto is semantic where anything matches."""
    finetune: bool = True
    """Square residual layers beside the core, the identity until trained."""
    residual: int = 0
    """Width of a side network from the observation straight to the action, zero at the start; 0 for none."""
    freeze: Mapping[str, float] = field(default_factory=dict)
    """For each part (`core`, `input_adapter`, ...) the share of the budget during which it does not learn: 1 for all of
    it, 0.5 to unfreeze it half way."""
    lr_scale: Mapping[str, float] = field(default_factory=lambda: {"core": 0.3})
    """Learning rate of a part as a multiple of the trainer's."""

    def __post_init__(self) -> None:
        for part, share in self.freeze.items():
            if not 0 <= share <= 1:
                raise ConfigError(f"freeze {part}={share} must lie between 0 and 1; 1 freezes it for the whole budget")
        for part, scale in self.lr_scale.items():
            if not scale > 0:
                raise ConfigError(f"lr_scale {part}={scale} must be above 0; use freeze to stop a part from learning")
        if self.residual < 0:
            raise ConfigError(f"residual={self.residual} must be 0 or a width")


WRAP_PRESETS: dict[Preset, WrapConfig] = {
    "default": WrapConfig(),
    "paper": WrapConfig(structure="paper", tap="action", adapter="random", lr_scale={"core": 1 / 3}),
}
"""`paper`: core at 1e-4 of 3e-4, as on InvertedDoublePendulum; on Hopper the paper uses 1e-5 (`lr_scale={'core': 1 / 30}`)."""


@dataclass(frozen=True)
class TrainConfig:
    """Everything a training run is determined by, besides its budget's clock."""

    env: str
    """Environment id."""
    core: str | None = None
    """Core id or folder; None trains from scratch."""
    member: int = 0
    """Which of the core's source seeds."""
    algo: Algorithm = "ppo"
    """Trainer."""
    preset: Preset = "default"
    """What the other fields were filled from."""
    seed: int = 0
    """Seed of every random stream."""
    episodes: int | None = None
    """Budget in completed episodes."""
    steps: int | None = None
    """Budget in environment steps."""
    seconds: float | None = None
    """Budget in seconds of training."""
    eval_episodes: int = 20
    """Episodes of an evaluation."""
    eval_every: int = 0
    """Environment steps between evaluations during training; 0 evaluates at the end only."""
    checkpoint_seconds: float = 20.0
    """Least time between checkpoints."""
    device: str = "cpu"
    """Torch device of the networks, `cpu` or `cuda`."""
    ppo: PPOConfig = field(default_factory=PPOConfig)
    """The trainer's own settings."""
    wrap: WrapConfig = field(default_factory=WrapConfig)
    """The sandwich's settings."""

    def __post_init__(self) -> None:
        if self.eval_episodes < 1 or self.eval_every < 0:
            raise ConfigError(f"eval_episodes={self.eval_episodes} and eval_every={self.eval_every} must be at least 1 and 0")


def preset(config: TrainConfig, name: Preset) -> TrainConfig:
    """The configuration with every setting of its trainer and its sandwich as the preset has them."""
    return replace(config, preset=name, ppo=PPO_PRESETS[name], wrap=WRAP_PRESETS[name])
