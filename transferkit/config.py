"""Configuration as frozen dataclasses: one source for defaults, command-line flags and records."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

from transferkit.errors import ConfigError

Algorithm = Literal["ppo", "dyna-ddpg", "dyna-ppo"]
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
class DynaConfig:
    """DYNA-DDPG: deterministic policy gradient (Lillicrap et al. 2016) with a learnt model (Sutton 1990)."""

    hidden: tuple[int, ...] = (128, 128)
    """Hidden layers of the policy that is trained from scratch, and of the critics."""
    activation: Literal["tanh", "relu", "elu"] = "relu"
    """Activation of the policy; critics and model take rectified units."""
    squash: bool = False
    """Bound the policy's mean by tanh (the paper); False clips it and inverts its gradients (Hausknecht & Stone 2016)."""
    layer_norm: bool = True
    """Normalise the layers of critics and model (Hiraoka et al. 2022: what makes many updates a step stable)."""
    critics: int = 2
    """Critics whose least value is the target (Fujimoto et al. 2018)."""
    actor_learning_rate: float = 3e-4
    """Adam step size; parts of a wrapped policy scale it."""
    critic_learning_rate: float = 3e-4
    """Adam step size of the critics."""
    schedule: Literal["fixed", "linear"] = "linear"
    """Learning rates of actor and critics: fixed, or linear to zero over the second half of the budget's steps. Not over all of
    it, nor by episodes where steps are limited too: 60 episodes are 300 steps where every one fails, and then thousands."""
    discount_seconds: float | None = 2.0
    """Time constant of the discount: a step is discounted by exp(-time step / it), so that tasks with other time steps look
    equally far ahead (Doya 2000; Tallec et al. 2019). None takes `gamma`."""
    gamma: float = 0.99
    """Discount per step, where `discount_seconds` is None or the environment has no time step."""
    tau: float = 0.1
    """Share of the networks that the target networks take over after each environment step, so that the targets of a step are
    computed at once; 0.02 an update, where Fujimoto et al. 2018 take 0.005: normalised critics bear it."""
    batch_size: int = 128
    """Transitions per update."""
    updates_per_step: int = 5
    """Critic updates per environment step (Chen et al. 2021 take 20)."""
    actor_every: int = 2
    """Critic updates per actor update (Fujimoto et al. 2018)."""
    exploration_noise: float = 0.3
    """Standard deviation added to actions, of a range of [-1, 1], at first; and to the targets' actions (Fujimoto et al. 2018),
    so that the critics value the policy that acts."""
    final_noise: float = 0.1
    """What it has become, linearly, at the end of the budget."""
    random_steps: int = 100
    """First steps, of standard normal noise alone; they last at least to the end of the first episode. 0 for none."""
    curious_until: int = 100
    """Until so many rewards differ from the first, and no episode has terminated, the model's disagreement is the reward: where
    no reward is met there is nothing else to learn from (Sekar et al. 2020). 0 for never."""
    overrun_steps: int = 0
    """First steps in which an ended episode goes on (the paper's code)."""
    buffer_size: int = 1_000_000
    """Transitions remembered."""
    reward_scale: float = 0.1
    """Rewards are multiplied by it in the critics."""
    normalize_observation: bool = True
    """Running mean and variance inside the policy."""
    initialization: Literal["orthogonal", "uniform"] = "orthogonal"
    """Of the policy's layers; `uniform` is `nn.Linear`'s own (the paper)."""
    wrap_critic: bool = True
    """Wrap the core's critic, where it has one; False starts with new critics."""
    wrap_dynamics: bool = True
    """Wrap the core's model, where it has one; False starts with a new model."""
    model_share: float = 0.0
    """Share of all transitions learnt from that are imagined. None by default, because no share was found to be better (docs:
    evidence); the model is then fitted for curiosity alone, as long as that lasts."""
    keep_model: bool = False
    """Fit the model even where nothing needs it; `pretrain` does, for the core's `dynamics` part."""
    mix_batches: bool = True
    """Mix real and imagined transitions, or put the imagined ones into the last batches of a step (the paper)."""
    horizon: int = 1
    """Steps of an imagined rollout (Janner et al. 2019)."""
    keep_share: float = 0.8
    """Share of the imagined transitions that is kept: those on which the members agree best."""
    planned_action: Literal["policy", "replayed"] = "policy"
    """Imagine what the current policy does, or what was done (the paper)."""
    planned_reward: Literal["learned", "minus-norm"] = "learned"
    """The model's reward, or minus the norm of the next observation (the paper)."""
    planned_termination: bool = True
    """Imagined episodes can end; the paper's cannot."""
    model_members: int = 5
    """Networks of the ensemble (Chua et al. 2018)."""
    model_hidden: tuple[int, ...] = (128, 128)
    """Hidden layers of each."""
    model_learning_rate: float = 1e-3
    """Adam step size of the model."""
    model_every: int = 250
    """Environment steps between fits of the model (Janner et al. 2019)."""
    model_updates: int = 250
    """At most so many batches a fit."""
    model_batch_size: int = 256
    """Transitions per batch and member."""
    model_loss: Literal["likelihood", "squared-error"] = "likelihood"
    """Gaussian with learnt variance, reward and termination; or the next observation alone (the paper)."""
    ppo_rollouts: int = 64
    """dyna-ppo: imagined rollouts side by side, `ppo_horizon` steps each for one update of the policy."""
    ppo_horizon: int = 16
    """dyna-ppo: steps of an imagined rollout; the critic values what follows."""
    ppo_updates: int = 10
    """dyna-ppo: rollouts and updates after each fit of the model."""
    predict: Literal["change", "state"] = "change"
    """What the model predicts of the next observation."""
    normalize_targets: bool = True
    """Predict in units of the targets' own deviations."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            flag = f"pass --dyna.{name.replace('_', '-')}"
            if name in AT_LEAST_ONE and value < 1:
                raise ConfigError(f"{name}={value} must be at least 1; {flag}")
            if name in SHARES and not 0 <= value <= 1:
                raise ConfigError(f"{name}={value} must lie between 0 and 1; {flag}")
            if name in RATES and not 0 < value <= 1:
                raise ConfigError(f"{name}={value} must be above 0 and at most 1; {flag}")
            if name in ("exploration_noise", "final_noise", "random_steps", "curious_until") and value < 0:
                raise ConfigError(f"{name}={value} must not be negative; {flag}")
        if self.gamma >= 1:
            raise ConfigError(f"gamma={self.gamma} must be below 1; pass --dyna.gamma")
        if self.discount_seconds is not None and self.discount_seconds <= 0:
            raise ConfigError(f"discount_seconds={self.discount_seconds} must be above 0; pass --dyna.discount-seconds")
        if self.model_loss == "squared-error" and (self.planned_reward == "learned" or self.planned_termination):
            raise ConfigError(
                "model_loss='squared-error' learns neither rewards nor terminations; pass --dyna.planned-reward minus-norm "
                "--dyna.no-planned-termination with it, or --dyna.model-loss likelihood"
            )

    def for_time_step(self, seconds: float) -> DynaConfig:
        """The same with the discount per step of an environment with this time step; 0 for one that has none."""
        if self.discount_seconds is None or not seconds:
            return self
        return replace(self, gamma=math.exp(-seconds / self.discount_seconds))


AT_LEAST_ONE = (
    "critics",
    "batch_size",
    "updates_per_step",
    "actor_every",
    "horizon",
    "model_members",
    "model_every",
    "model_updates",
    "model_batch_size",
    "buffer_size",
    "ppo_rollouts",
    "ppo_horizon",
    "ppo_updates",
)
SHARES = ("gamma", "model_share")
RATES = ("actor_learning_rate", "critic_learning_rate", "model_learning_rate", "tau", "keep_share")

DYNA_PRESETS: dict[Preset, DynaConfig] = {
    "default": DynaConfig(),
    "paper": DynaConfig(
        hidden=(256, 256),
        squash=True,
        layer_norm=False,
        critics=1,
        critic_learning_rate=1e-3,
        schedule="fixed",
        updates_per_step=11,
        actor_every=11,
        tau=0.005,
        discount_seconds=None,
        exploration_noise=0.0,
        final_noise=0.0,
        random_steps=0,
        curious_until=0,
        overrun_steps=128,
        reward_scale=1.0,
        normalize_observation=False,
        initialization="uniform",
        model_share=10 / 11,
        mix_batches=False,
        keep_share=1.0,
        planned_action="replayed",
        planned_reward="minus-norm",
        planned_termination=False,
        model_members=1,
        model_hidden=(256, 256),
        model_every=1,
        model_updates=1,
        model_batch_size=128,
        model_loss="squared-error",
        predict="state",
        normalize_targets=False,
    ),
}
"""`paper` follows its DYNA-DDPG code (docs: departures from the paper)."""


@dataclass(frozen=True)
class WrapConfig:
    """How a core is built into the policy of another environment."""

    structure: Literal["default", "paper"] = "default"
    """The healthy sandwich, or the paper's with its ReLUs and its shared output layer."""
    tap: Literal["features", "action"] = "features"
    """Take the core's last hidden layer, or its action output as the paper does."""
    adapter: Literal["auto", "semantic", "random", "pad"] = "auto"
    """Fill the adapters from what the numbers mean, at random, or (a control) element by element with zeros for what lacks;
    auto is semantic where anything matches, else random."""
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
    """Environment steps between evaluations, the first before any training; 0 evaluates at the end only."""
    checkpoint_seconds: float = 20.0
    """Least time between checkpoints."""
    device: str = "cpu"
    """Torch device of the networks, `cpu` or `cuda`."""
    experience: tuple[str, ...] = ()
    """dyna-ddpg: recordings (FILE.mcap) and Minari datasets (minari:NAME) to learn from before the first real step."""
    mapping: str | None = None
    """TOML file that names the channels of other tools' recordings."""
    ppo: PPOConfig = field(default_factory=PPOConfig)
    """PPO's settings."""
    dyna: DynaConfig = field(default_factory=DynaConfig)
    """DYNA-DDPG's settings."""
    wrap: WrapConfig = field(default_factory=WrapConfig)
    """The sandwich's settings."""

    def __post_init__(self) -> None:
        if self.eval_episodes < 1 or self.eval_every < 0:
            raise ConfigError(f"eval_episodes={self.eval_episodes} and eval_every={self.eval_every} must be at least 1 and 0")
        if self.experience and self.algo != "dyna-ddpg":
            raise ConfigError(f"{self.algo} does not learn from recordings; pass --algo dyna-ddpg, or leave out --experience")
        if self.algo == "dyna-ppo" and self.dyna.model_loss != "likelihood":
            raise ConfigError("dyna-ppo needs a model that learns rewards; the paper has no code for it: use --preset default")


def preset(config: TrainConfig, name: Preset) -> TrainConfig:
    """The configuration with every setting of its trainer and its sandwich as the preset has them."""
    return replace(config, preset=name, ppo=PPO_PRESETS[name], dyna=DYNA_PRESETS[name], wrap=WRAP_PRESETS[name])
