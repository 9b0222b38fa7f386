"""Settings of DYNA-DDPG and DYNA-PPO."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

from transferkit.config.names import Preset, check_choices
from transferkit.errors import ConfigError


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
    """First steps, of standard normal noise alone; they last at least to the end of the first episode. 0 for none. A core acts
    from the first step on."""
    anchor: float = 0.1
    """How much a policy with a core is held to what it did at first, beside its value (Fujimoto & Gu 2021 take 0.4); it falls
    to zero, linearly, over the budget. The critics know nothing of the target at first, and a policy that follows them forgets
    what it could."""
    curious_until: int = 100
    """Until so many rewards differ from their median, and no episode has terminated, the model's disagreement is the reward:
    where no reward is met there is nothing else to learn from (Sekar et al. 2020). 0 for never."""
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
    wrap_critic: bool = False
    """Wrap the core's critics, where it has as many; by default they are new, because with wrapped ones a larger robot was
    learnt more slowly (docs: evidence)."""
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
        check_choices(self)
        for name, value in vars(self).items():
            flag = f"pass --dyna.{name.replace('_', '-')}"
            if name in AT_LEAST_ONE and value < 1:
                raise ConfigError(f"{name}={value} must be at least 1; {flag}")
            if name in SHARES and not 0 <= value <= 1:
                raise ConfigError(f"{name}={value} must lie between 0 and 1; {flag}")
            if name in RATES and not 0 < value <= 1:
                raise ConfigError(f"{name}={value} must be above 0 and at most 1; {flag}")
            if name in ("exploration_noise", "final_noise", "random_steps", "curious_until", "anchor") and value < 0:
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
        anchor=0.0,
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
