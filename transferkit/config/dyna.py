"""Settings of DYNA-DDPG, of DYNA-PPO, and of the learnt model that both have."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from transferkit.config.checks import (
    AT_LEAST_ONE,
    BATCH,
    MEMBERS,
    NOT_NEGATIVE,
    POSITIVE,
    RATE,
    SHARE,
    Hidden,
    Range,
    check,
)

HORIZON, BUFFER = Range(1, 1000), Range(1, 100_000_000)
"""Imagined steps, and transitions in memory; the buffer grows as it fills."""


@dataclass(frozen=True)
class DynaConfig:
    """DYNA-DDPG: deterministic policy gradient (Lillicrap et al. 2016) with a learnt model (Sutton 1990)."""

    layer_norm: bool = True
    """Normalise the critics' layers (Hiraoka et al. 2022: what makes many updates a step stable)."""
    critics: Annotated[int, MEMBERS] = 2
    """Critics whose least value is the target (Fujimoto et al. 2018)."""
    pessimism: Annotated[float, SHARE] = 1.0
    """How far from the critics' mean to their least value the target is: critics with normalised layers need less caution, and
    who fears what is new stands still (Moskovitz et al. 2021; Nauman et al. 2024)."""
    drawn_critics: Annotated[int, MEMBERS] | None = None
    """Critics drawn at random for each step's targets, whose least value is the target (Chen et al. 2021); None for all."""
    unit_norm: bool = False
    """Keep the weights of every hidden unit of the critics at a norm of one (Lee et al. 2025)."""
    actor_learning_rate: Annotated[float, RATE] = 3e-4
    """Adam step size; parts of a wrapped policy scale it."""
    critic_learning_rate: Annotated[float, RATE] = 3e-4
    """Adam step size of the critics."""
    schedule: Literal["fixed", "linear"] = "linear"
    """Learning rates of actor and critics: fixed, or linear to zero over the second half of the budget's steps. Not over all of
    it, nor by episodes if steps are limited too: 60 episodes are 300 steps while every one fails, and then thousands."""
    discount_seconds: Annotated[float, POSITIVE] | None = 2.0
    """Time constant of the discount: a step is discounted by exp(-time step / it), so that tasks with other time steps look
    equally far ahead (Doya 2000; Tallec et al. 2019). None takes `gamma`."""
    gamma: Annotated[float, Range(0, 1, open_high=True)] = 0.99
    """Discount per step, or per held action, if `discount_seconds` is None or the environment has no time step."""
    tau: Annotated[float, RATE] = 0.1
    """Share of the networks that the target networks take over after each environment step, so that the targets of a step are
    computed at once; 0.02 an update, while Fujimoto et al. 2018 take 0.005: normalised critics bear it."""
    batch_size: Annotated[int, BATCH] = 128
    """Transitions per update."""
    updates_per_step: Annotated[int, Range(1, 1000)] = 5
    """Critic updates per environment step, or per action if that is held for several (Chen et al. 2021 take 20)."""
    even_updates: bool = False
    """As many updates in a second of experience for a core as from scratch: one that acts more often than every `hold_seconds`
    has as many fewer after each action."""
    actor_every: Annotated[int, AT_LEAST_ONE] = 2
    """Critic updates per actor update (Fujimoto et al. 2018)."""
    exploration_noise: Annotated[float, NOT_NEGATIVE] = 0.3
    """Standard deviation added to actions, of a range of [-1, 1], at first; and to the targets' actions (Fujimoto et al. 2018),
    so that the critics value the policy that acts."""
    final_noise: Annotated[float, NOT_NEGATIVE] = 0.1
    """The noise at the end of the budget; it changes linearly."""
    hold_seconds: Annotated[float, NOT_NEGATIVE] = 0.0
    """Time for which an action is held while learning, at least one step: in short steps what an action is worth is lost in
    noise. The policy that comes of it acts in every step, and so does a core from the first one."""
    random_steps: Annotated[int, NOT_NEGATIVE] = 100
    """First steps, of standard normal noise alone; they last at least to the end of the first episode. 0 for none. A core acts
    from the first step on."""
    anchor: Annotated[float, NOT_NEGATIVE] = 0.1
    """How much a policy with a core is held to what it did at first, beside its value (Fujimoto & Gu 2021 take 0.4): the
    critics know nothing of the target at first, and a policy that follows them forgets what it could do. It falls linearly to
    zero over the budget, unless one of the next two says otherwise."""
    anchor_holds: bool = False
    """Keep the whole anchor for as long as the latest training episodes are worse than the core's on probation."""
    anchor_halves: Annotated[float, SHARE] = 0.0
    """Share of the budget in which the anchor halves while the latest one to five training episodes are as good as the core's
    on probation, less a tenth of its gain for their noise; it doubles again while they are worse. Replaces `anchor_holds`.
    With 0, or without probation, that and the budget decide."""
    curious_until: Annotated[int, NOT_NEGATIVE] = 100
    """Until so many rewards differ from their median, and no episode has terminated, the model's disagreement is the reward: a
    run that meets no reward has nothing else to learn from (Sekar et al. 2020). 0 for never."""
    average_share: Annotated[float, SHARE] = 0.0
    """The policy that a run ends with is the average of those of the last share of its steps (Polyak & Juditsky 1992): one that
    is trained fast is good in one step and not in the next. 0 for the last policy itself."""
    keep_peak: bool = False
    """A run whose training episodes get worse again ends with the policy of its best five in a row, so that what was learnt is
    not lost (after Fujimoto et al. 2023)."""
    keep_tried: bool = False
    """What is kept of a peak has been tried: while an episode lasts, nothing that is learnt in it before its return is higher
    than each of the last five. Else that is kept unseen, and what spoils a policy meanwhile with it."""
    overrun_steps: Annotated[int, NOT_NEGATIVE] = 0
    """First steps in which an ended episode goes on (the paper's code)."""
    buffer_size: Annotated[int, BUFFER] = 1_000_000
    """Transitions remembered."""
    early_share: Annotated[float, SHARE] = 0.0
    """Share of the transitions learnt from that are drawn by their discount since the episode began, as the policy gradient
    weights them (Sutton et al. 2000; Thomas 2014). The rest is drawn evenly: once episodes are long, starts, which decide all,
    are hardly among them."""
    mirror: bool = False
    """Learn from the mirror image of every other transition, if the simulation has one: a pole that falls to the left teaches
    what one that falls to the right does, and one leg what the other (Lin et al. 2020)."""
    reward_scale: float = 0.1
    """Factor of rewards in the critics."""
    normalize_reward: bool = False
    """Divide rewards in the critics by the running deviation of the discounted return."""
    model_share: Annotated[float, SHARE] = 0.0
    """Share of all transitions learnt from that are imagined. None by default, because no share was found to be better (study
    `model_share`); the model is then fitted for curiosity alone, as long as that lasts."""
    keep_model: bool = False
    """Fit the model even if nothing needs it; `pretrain` does, for the core's `dynamics` component."""
    mix_batches: bool = True
    """Mix real and imagined transitions, or put the imagined ones into the last batches of a step (the paper)."""
    horizon: Annotated[int, HORIZON] = 1
    """Steps of an imagined rollout (Janner et al. 2019)."""
    keep_share: Annotated[float, RATE] = 0.8
    """Share of the imagined transitions that is kept: those on which the members agree best."""
    planned_action: Literal["policy", "replayed"] = "policy"
    """Imagine what the current policy does, or what was done (the paper)."""
    planned_reward: Literal["learned", "minus-norm"] = "learned"
    """Take the model's reward, or minus the norm of the next observation (the paper)."""
    planned_termination: bool = True
    """Let imagined episodes end; the paper's cannot."""

    def __post_init__(self) -> None:
        check(self, "dyna")

    def hold_steps(self, time_step: float) -> int:
        """Steps of this many seconds for which an action is held."""
        return max(1, round(self.hold_seconds / time_step)) if time_step else 1

    def updates(self, hold: int, time_step: float) -> int:
        """Critic updates after an action that is held for this many steps of this many seconds."""
        if not self.even_updates:
            return self.updates_per_step
        return math.ceil(hold * self.updates_per_step / self.hold_steps(time_step))

    def discount(self, time_step: float) -> float:
        """The discount per step of an environment with this time step in seconds; 0 for one that has none."""
        if self.discount_seconds is None or not time_step:
            return self.gamma ** (1 / self.hold_steps(time_step))
        return math.exp(-time_step / self.discount_seconds)


@dataclass(frozen=True)
class ModelConfig:
    """An ensemble that predicts observations, rewards and terminations (Chua et al. 2018), for DYNA-DDPG and DYNA-PPO."""

    members: Annotated[int, MEMBERS] = 5
    """Networks of the ensemble."""
    hidden: Hidden = (128, 128)
    """Hidden layers of each."""
    layer_norm: bool = True
    """Normalise the hidden layers."""
    learning_rate: Annotated[float, RATE] = 1e-3
    """Adam step size."""
    every: Annotated[int, AT_LEAST_ONE] = 250
    """Environment steps between fits (Janner et al. 2019)."""
    updates: Annotated[int, AT_LEAST_ONE] = 250
    """Most batches per fit."""
    batch_size: Annotated[int, BATCH] = 256
    """Transitions per batch and member."""
    loss: Literal["likelihood", "squared-error"] = "likelihood"
    """Gaussian with learnt variance, reward and termination; or the next observation alone (the paper)."""
    predict: Literal["change", "state"] = "change"
    """Predict the change of the observation, or the next observation itself (the paper)."""
    normalize_targets: bool = True
    """Predict in units of the targets' own deviations."""

    def __post_init__(self) -> None:
        check(self, "model")


@dataclass(frozen=True)
class DynaPPOConfig:
    """PPO on imagined rollouts; the settings of PPO and of the model hold too."""

    rollouts: Annotated[int, BATCH] = 64
    """Imagined rollouts side by side, in place of PPO's environments."""
    horizon: Annotated[int, HORIZON] = 16
    """Steps of an imagined rollout; the critic values what comes after it."""
    updates: Annotated[int, AT_LEAST_ONE] = 10
    """Rollouts and updates after each fit of the model."""
    buffer_size: Annotated[int, BUFFER] = 1_000_000
    """Transitions remembered, to which the model is fitted."""

    def __post_init__(self) -> None:
        check(self, "dyna_ppo")
