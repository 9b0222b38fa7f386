"""The networks of DYNA-DDPG, their optimisers, and one environment step's worth of learning."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from transferkit.nn import Learner, Part, flatten
from transferkit.policy.wrapped_ensemble import learning_parts, thaw
from transferkit.trainers.dyna.anchor import Anchor
from transferkit.trainers.dyna.fit import fit
from transferkit.trainers.dyna.held import Held, held_transitions
from transferkit.trainers.dyna.image import Image
from transferkit.trainers.dyna.imagine import imagine, novelty
from transferkit.trainers.dyna.programs import programs
from transferkit.trainers.dyna.replay import ReplayBuffer
from transferkit.trainers.dyna.updates import Minibatches, Networks
from transferkit.trainers.running_return import RunningReturn

if TYPE_CHECKING:
    from transferkit.config import DynaConfig, ModelConfig
    from transferkit.envs import Mirror, Step
    from transferkit.nn import Critic, Dynamics, PartAdam
    from transferkit.policy.base import Policy
    from transferkit.streams import Streams
    from transferkit.trainers.dyna.replay import Batch

LONGEST_WARM_UP = 10
"""Factor of `random_steps` after which the warm-up ends in any case."""

LARGEST_PROGRAM = 4
"""Most updates that are compiled into one program: more take longer to compile, and win little."""

NOISE_CLIP = 2.5
"""Bound of the noise in the targets' actions, in standard deviations (Fujimoto et al. 2018)."""

M = TypeVar("M", bound=nn.Module)


class Agent:
    """Actor, critics, model and replay buffer; `explore`, `observe` and `learn` are called once for each environment step."""

    def __init__(
        self,
        policy: Policy,
        critic: Critic,
        model: Dynamics,
        config: DynaConfig,
        model_config: ModelConfig,
        streams: Streams,
        device: torch.device,
        *,
        time_step: float,
        mirror: Mirror | None = None,
        compiles: bool = False,
    ) -> None:
        """Make buffer, optimisers and target networks for an environment with this time step in seconds and mirror image.

        `policy` becomes the average of what is learnt, if the configuration asks for one.
        """
        self.average, self.critic, self.model, self.device = policy, critic, model, device
        self.policy = policy = self._copy(policy) if config.average_share else policy
        self.config, self.model_config = config, model_config
        self.hold = policy.hold if policy.has_core else config.hold_steps(time_step)  # a core acts at the rate it learnt
        self.step_discount = config.discount(time_step)
        self.discount = self.step_discount**self.hold
        self.updates_per_action = config.updates(self.hold, time_step)
        self.buffer = ReplayBuffer(policy.obs_dim, policy.act_dim, config.buffer_size, device)
        self._image = None if mirror is None else Image(mirror, device)
        self.returns = RunningReturn(1, self.step_discount)
        groups = policy.parameter_groups()
        actor = Learner(policy, [Part(g.parameters, g.lr_scale) for g in groups], config.actor_learning_rate)
        critics = Learner(critic, learning_parts(critic, policy), config.critic_learning_rate)
        self.actor_optimizer, self.critic_optimizer = actor.optimizer, critics.optimizer
        self.model_learner = Learner(model, learning_parts(model, policy), model_config.learning_rate)
        self.target_policy, self.target_critic = self._copy(policy), self._copy(critic)
        self._targets = [flatten(g.parameters) for g in self.target_policy.parameter_groups()]
        self._targets += [flatten(part.parameters) for part in learning_parts(self.target_critic, policy)]
        self._averages = [flatten(g.parameters) for g in self.average.parameter_groups()] if config.average_share else []
        self._online = [*self.actor_optimizer.flat, *self.critic_optimizer.flat]
        self.exploration, self.batches = streams.torch("action noise", device), streams.torch("minibatches", device)
        self.imagination = streams.torch("imagination", device)
        self.first_policy = self._copy(policy) if policy.has_core and config.anchor else None
        self.networks, self.programs = Networks(actor, critics, self.first_policy), programs(device, compiles=compiles)
        self._warming_up = config.random_steps > 0 and not policy.has_core
        self._rewarded, self._held, self.steps, self.updates, self._age = False, None, 0, 0, 0
        self.losses: dict[str, Tensor] = {}
        self.anchor = Anchor(config)
        self.set_progress(0.0, 0.0)

    @torch.no_grad()
    def explore(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Choose actions `(1, act_dim)`: the one that is held, noise alone at first, then the policy's with noise."""
        if self._held is not None:
            return self._held.action
        noise = torch.randn(1, self.policy.act_dim, generator=self.exploration, device=self.device)
        if self._warming_up:
            return noise.clamp(-1.0, 1.0).cpu().numpy()
        mean = self.policy(torch.from_numpy(observation).to(self.device))[0]
        return (mean + self.noise * noise).clamp(-1.0, 1.0).cpu().numpy()

    def observe(self, observation: NDArray[np.float32], action: NDArray[np.float32], step: Step) -> None:
        """Remember a step of the one environment, once its action is no longer held."""
        self.steps += 1
        done, held = bool(step.done[0]), (self._held or Held(observation, action)).after(step, self.step_discount)
        over = held.age == self.hold
        if over or step.terminated[0]:  # not what the time limit cut short
            weight = self.step_discount ** (self._age + 1 - held.age)
            self.buffer.add_step(held.observation, held.action, held.whole(step), weight)
        self._held, self._age = None if over or done else held, 0 if done else self._age + 1
        self.policy.update_normalizer(torch.from_numpy(observation).to(self.device))
        if self.config.normalize_reward:
            self.returns.add(step.reward, step.done)
        # To the end of an episode, but not for ever if episodes do not end.
        past = self.steps / max(self.config.random_steps, 1)
        if (done and past >= 1) or past >= LONGEST_WARM_UP:
            self._warming_up = False

    def remember(self, prior: Batch) -> None:
        """Start from transitions `(N, ...)` of elsewhere: without random steps, and with a model of them if it is needed."""
        self.buffer.extend(*held_transitions(prior, self.hold, self.step_discount))
        self.policy.update_normalizer(prior.observation.to(self.device))
        if self.config.normalize_reward:
            for reward, terminated in zip(prior.reward.numpy(), prior.terminated.numpy() > 0, strict=True):
                self.returns.add(reward[None], terminated[None])
        self._warming_up = False
        if self.buffer.added and self.needs_model:
            self._fit()

    def learn(self) -> None:
        """Do the updates that follow one environment step; none before the buffer holds a batch, or while an action is held."""
        config = self.config
        if self.buffer.added < config.batch_size:
            return
        if self.steps % self.model_config.every == 0 and self.needs_model:
            self._fit()
        if self._held is not None:
            return
        rows = self._batches()
        batch = self.buffer.split(rows if self._image is None else self._image.of_half(rows, self.batches))
        if self.fitted and self.unrewarded:  # learn from what is new
            batch = batch._replace(reward=novelty(self.model, batch))
        target = self.programs.td_target(
            self.target_policy,
            self.target_critic,
            batch,
            self._target_noise(batch),
            reward_scale=torch.tensor(self.reward_scale, device=self.device),
            discount=self.discount,
            pessimism=config.pessimism,
            members=self._drawn_critics(),
        )
        self._descend(batch, target)
        with torch.no_grad():
            for slow, fast in zip(self._targets, self._online, strict=True):
                slow.lerp_(fast, config.tau)
            for average, fast in zip(self._averages, self.actor_optimizer.flat, strict=False):
                average.lerp_(fast, min(1.0, self.hold / max(1.0, config.average_share * self.steps)))

    @property
    def reward_scale(self) -> float:
        """What rewards are multiplied by in the critics."""
        return self.config.reward_scale / (self.returns.deviation if self.config.normalize_reward else 1.0)

    @property
    def fitted(self) -> bool:
        """Whether the model has been trained at all."""
        return "model" in self.losses

    @property
    def needs_model(self) -> bool:
        """Whether the model is fitted further: to imagine with, for a core to keep, or to tell what is new."""
        return self.config.model_share > 0 or self.config.keep_model or self.unrewarded

    @property
    def unrewarded(self) -> bool:
        """Whether neither rewards nor terminations have ever said what is good."""
        if not self._rewarded and self.buffer.added:
            seen = self.buffer.all()
            different = (seen.reward != seen.reward.median()).sum()
            self._rewarded = bool(seen.terminated.any() | (different >= self.config.curious_until))
        return not self._rewarded

    @property
    def largest_return(self) -> float:
        """The largest possible discounted sum of rewards, in the critic's scale; at least that of novelty, which is below 1."""
        largest, config = 1.0, self.config
        if self.buffer.added:
            seen = self.buffer.all()
            largest = max(largest, float(seen.reward.abs().max()))
            if config.model_share and config.planned_reward == "minus-norm":
                largest = max(largest, float(torch.linalg.vector_norm(seen.next_observation, dim=-1).max()))
        return self.reward_scale * largest / max(1 - self.discount, np.finfo(float).eps)

    def set_progress(self, progress: float, step_progress: float, *, behind: bool | None = None) -> None:
        """Freeze, unfreeze, let go and calm down for a run that has used these shares of its budget and of its steps.

        One that is `behind` its core may not let it go; None if that is not known.
        """
        config = self.config
        self.anchor.follow(progress, behind=behind)
        self.noise = config.exploration_noise + progress * (config.final_noise - config.exploration_noise)
        self.policy.at_progress(progress)
        for part in (self.critic, self.model):
            thaw(part, self.policy, progress)
        factor = min(1.0, 2 * (1 - step_progress)) if config.schedule == "linear" else 1.0
        rates = config.actor_learning_rate, config.critic_learning_rate
        for optimizer, rate in zip((self.actor_optimizer, self.critic_optimizer), rates, strict=True):
            for group in optimizer.param_groups:
                group["lr"] = rate * factor

    def metrics(self) -> dict[str, float]:
        """Return the latest losses, and how firmly a policy with a core is held to it."""
        held = {} if self.first_policy is None else {"anchor": self.anchor.weight}
        return {name: float(loss) for name, loss in self.losses.items()} | held

    def state(self) -> dict[str, Any]:
        """Return everything that the next step depends on."""
        return {
            "modules": {name: module.state_dict() for name, module in self._modules().items()},
            "optimizers": [optimizer.state_dict() for optimizer in self._optimizers()],
            "generators": [generator.get_state() for generator in self._generators()],
            "buffer": self.buffer.state(),
            "steps": self.steps,
            "updates": self.updates,
            "age": self._age,
            "held": [] if self._held is None else [self._held.state()],
            "warming_up": self._warming_up,
            **self.anchor.state(),
            "rewarded": self._rewarded,
            "losses": self.losses,
            "returns": self.returns.state(),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Take what `state` returned."""
        for name, module in self._modules().items():
            module.load_state_dict(state["modules"][name])
        for optimizer, saved in zip(self._optimizers(), state["optimizers"], strict=True):
            optimizer.load_state_dict(saved)
        for generator, saved in zip(self._generators(), state["generators"], strict=True):
            generator.set_state(saved)
        self.buffer.restore(state["buffer"])
        self.steps, self._age = state.get("steps", self.buffer.added), int(state.get("age", 0))
        self.updates = int(state.get("updates", 0))
        held = [Held.restored(one, (self.buffer.obs_dim, self.buffer.act_dim)) for one in state.get("held", [])]
        self._held = held[0] if held else None
        self._warming_up = state["warming_up"]
        self.anchor.restore(state)
        self._rewarded = state.get("rewarded", False)  # earlier versions asked the buffer, which forgets
        if "returns" in state:
            self.returns.restore(state["returns"])
        self.losses = {name: loss.reshape(()) for name, loss in state["losses"].items()}

    def _fit(self) -> None:
        loss = fit(self.model_learner, self.buffer, self.model_config, self.imagination, self.programs.update_model)
        self.losses["model"] = torch.tensor(loss)

    def _batches(self) -> Tensor:
        """Draw rows `(updates_per_action, batch_size, width)`, the model's share of them imagined."""
        config = self.config
        count, size = self.updates_per_action, config.batch_size
        imagined = round(config.model_share * count * size) if self.fitted else 0
        if not imagined:
            return self.buffer.sample((count, size), self.batches, config.early_share)
        made_of = self.policy, self.model, self.buffer, config, self.imagination
        options = {"members": self.model_config.members, "noise": self.noise, "step": self.programs.imagined_step}
        rows = imagine(imagined, *made_of, **options)
        mixed = torch.cat((self.buffer.sample((count * size - imagined,), self.batches, config.early_share), rows))
        if config.mix_batches:
            mixed = mixed[torch.randperm(count * size, generator=self.batches, device=self.device)]
        return mixed.view(count, size, -1)

    def _target_noise(self, batch: Batch) -> Tensor:
        noise = torch.randn(batch.action.shape, generator=self.batches, device=self.device)
        return self.noise * noise.clamp_(-NOISE_CLIP, NOISE_CLIP)

    def _drawn_critics(self) -> Tensor | None:
        """Draw the critics of a step's targets, `(drawn_critics,)`."""
        count, drawn = self.config.critics, self.config.drawn_critics
        if drawn is None or drawn >= count:
            return None
        return torch.randperm(count, generator=self.batches, device=self.device)[:drawn]

    def _descend(self, batch: Batch, target: Tensor) -> None:
        """Update the critics with every minibatch and the actor with some, a few at once."""
        count, every = self.updates_per_action, self.config.actor_every
        first = self.updates or self.steps * count  # as runs counted before an action could be held
        self.updates = first + count
        with_actor = [(first + k) % every == 0 for k in range(count)]
        rates = torch.zeros(count, len(self.actor_optimizer.flat), 2, device=self.device)
        rates[with_actor] = self.actor_optimizer.rates(sum(with_actor))
        tensors = Minibatches(batch.observation, batch.action, target, self.critic_optimizer.rates(count), rates)
        anchor = torch.tensor(self.anchor.weight, device=self.device)
        for k in range(0, count, size := min(every, LARGEST_PROGRAM)):
            part = Minibatches(*(tensor[k : k + size] for tensor in tensors))
            loss, actors_loss = self.programs.update(self.networks, part, anchor, tuple(with_actor[k : k + size]))
            self.losses["critic"] = loss
            if any(with_actor[k : k + size]):
                self.losses["actor"] = actors_loss
        self.losses["value"] = target[-1].mean()

    def _modules(self) -> dict[str, nn.Module]:
        names = ("policy", "critic", "model", "target_policy", "target_critic")
        modules: dict[str, nn.Module] = {name: getattr(self, name) for name in names}
        if self._averages:
            modules["average"] = self.average
        if self.first_policy is not None:
            modules["first_policy"] = self.first_policy
        return modules

    def _optimizers(self) -> tuple[PartAdam, ...]:
        return self.actor_optimizer, self.critic_optimizer, self.model_learner.optimizer

    def _generators(self) -> tuple[torch.Generator, ...]:
        return self.exploration, self.batches, self.imagination

    def _copy(self, module: M) -> M:
        """Make a target network; it shares the normaliser, whose statistics are not learnt."""
        normalizer = self.average.normalizer
        return copy.deepcopy(module, {} if normalizer is None else {id(normalizer): normalizer})
