"""DYNA-DDPG's updates against peers and against its matrix products alone, in alternation within one run."""

from __future__ import annotations

import importlib
import importlib.util
import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Protocol

import gymnasium
import numpy as np
import torch
from stable_baselines3 import TD3
from stable_baselines3.common.logger import Logger
from torch import Tensor, nn

from experiments.bench.timing import seconds
from transferkit.config import TrainConfig, with_settings
from transferkit.envs import derive_spec, make_env
from transferkit.nn import Dynamics
from transferkit.policy.critic_and_model import make_critic, make_dynamics
from transferkit.policy.make import new_policy
from transferkit.streams import Streams
from transferkit.trainers.dyna.agent import Agent
from transferkit.trainers.dyna.imagine import imagine
from transferkit.trainers.dyna.losses import dynamics_loss
from transferkit.trainers.dyna.replay import Batch

ENV, OBS, ACT, WIDTH, BATCH, UPDATES = "Hopper-v5", 11, 3, 128, 128, 20
MODEL_BATCH, MODEL_MEMBERS, ROLLOUTS = 256, 5, 1280

Call = Callable[[], object]


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    rounds: int


FULL, TINY = Size(25), Size(1)


def main(size: Size) -> None:
    """Measure and print."""
    torch.set_num_threads(1)
    peers = importlib.import_module("mbrl.models") if importlib.util.find_spec("mbrl") else None
    compare(
        f"{UPDATES} updates of DDPG with two critics, {WIDTH}-{WIDTH}, batches of {BATCH}, actor every 2nd (must be 1.5)",
        {
            "transferkit": agent(layer_norm=False).learn,
            "transferkit with layer normalisation, its default": agent(layer_norm=True).learn,
            "stable-baselines3 TD3": td3(),
            "matrix products alone": products(),
        },
        size.rounds,
    )
    peer = {"mbrl-lib": peer_update(peers)} if peers else {"a loop over networks": loop_update()}
    compare(
        f"an update of an ensemble of {MODEL_MEMBERS}, {WIDTH}-{WIDTH}, batches of {MODEL_BATCH} (must be 3)",
        {"transferkit": model_update(), **peer, "matrix products alone": model_products()},
        size.rounds,
    )
    if peers:
        calls = {"transferkit": rollout(), "mbrl-lib": peer_rollout(peers)}
        compare(f"{ROLLOUTS} imagined steps (must be 3)", calls, size.rounds)


def compare(title: str, calls: dict[str, Call], rounds: int) -> None:
    """Time the calls in turns and print each one's ratio to the first."""
    for call in calls.values():
        call()
    times = [{name: seconds(call) for name, call in calls.items()} for _ in range(rounds)]
    base = next(iter(calls))
    print(title)
    for name in calls:
        ratios = sorted(one[name] / one[base] for one in times)
        milliseconds = 1e3 * statistics.median(one[name] for one in times)
        low, high = ratios[len(ratios) // 10], ratios[-1 - len(ratios) // 10]
        print(f"  {name}: {milliseconds:.1f} ms, {statistics.median(ratios):.2f} times ours ({low:.2f} to {high:.2f})")


def agent(*, layer_norm: bool) -> Agent:
    """Our learner with a buffer of made-up transitions."""
    settings = {"network.hidden": (WIDTH, WIDTH), "network.init_std": 1.0, "dyna.batch_size": BATCH}
    settings |= {"dyna.updates_per_step": UPDATES, "dyna.actor_every": 2, "dyna.layer_norm": layer_norm}
    settings |= {"model.layer_norm": layer_norm}
    config, streams = with_settings(TrainConfig(ENV, algo="dyna-ddpg"), settings), Streams(0)
    policy = new_policy(config, None)
    critic = make_critic(policy, config.dyna, config.network.hidden, streams.torch("critic"))
    model = make_dynamics(policy, derive_spec(ENV), config.model, streams.torch("model"))
    device = torch.device("cpu")
    ours = Agent(policy, critic, model, config.dyna, config.model, streams, device, discount=config.dyna.gamma)
    generator = streams.torch("transitions")
    for _ in range(2000):
        observation, following = torch.randn(2, OBS, generator=generator)
        action, reward = torch.rand(ACT, generator=generator) * 2 - 1, torch.randn((), generator=generator)
        ours.buffer.add(Batch(observation, action, reward, following, torch.zeros(())))
    return ours


def td3() -> Call:
    """stable-baselines3's TD3 on the same number of updates."""
    layers = {"net_arch": [WIDTH, WIDTH]}
    model = TD3("MlpPolicy", gymnasium.make(ENV), batch_size=BATCH, policy_delay=2, policy_kwargs=layers)
    model.set_logger(Logger(None, []))
    assert model.replay_buffer is not None
    rng = np.random.default_rng(0)
    for _ in range(2000):
        observation, following = rng.normal(size=(2, 1, OBS)).astype(np.float32)
        action = rng.uniform(-1, 1, (1, ACT)).astype(np.float32)
        model.replay_buffer.add(observation, following, action, rng.normal(size=1), np.zeros(1), [{}])
    return lambda: model.train(gradient_steps=UPDATES, batch_size=BATCH)


def products() -> Call:
    """The matrix products of a step's updates and nothing else."""
    w, generator = WIDTH, torch.Generator().manual_seed(0)

    def rand(*shape: int) -> Tensor:
        return torch.randn(*shape, generator=generator)

    inputs, hidden, grad = rand(2, BATCH, OBS + ACT), rand(2, BATCH, w), rand(2, BATCH, w)
    first, second = rand(2, OBS + ACT, w), rand(2, w, w)
    wide, big = rand(UPDATES * BATCH, w), rand(2, UPDATES * BATCH, w)

    def critic() -> None:
        torch.bmm(inputs, first)
        torch.bmm(hidden, second)
        torch.bmm(hidden.transpose(1, 2), grad)
        torch.bmm(grad, second.transpose(1, 2))
        torch.bmm(inputs.transpose(1, 2), grad)

    def actor() -> None:
        torch.bmm(inputs, first)
        torch.bmm(hidden, second)
        torch.bmm(grad, second.transpose(1, 2))
        torch.bmm(grad, first.transpose(1, 2))
        torch.mm(hidden[0], second[0])
        torch.mm(hidden[0].T, grad[0])
        torch.mm(grad[0], second[0].T)

    def step() -> None:
        torch.mm(wide, second[0])
        torch.bmm(big, second)
        for k in range(UPDATES):
            critic()
            if k % 2 == 0:
                actor()

    return step


def model_update() -> Call:
    """One update of our ensemble."""
    ours = agent(layer_norm=False)
    batch = ours.buffer.split(ours.buffer.sample((MODEL_MEMBERS, MODEL_BATCH), ours.batches))

    target = ours.model.targets(batch.observation, batch.reward, batch.next_observation)
    learner = ours.model_learner
    return lambda: update(learner, batch, target, learner.optimizer.rates(1)[0], dynamics_loss)


def model_products() -> Call:
    """The matrix products of one update of the ensemble and nothing else."""
    sizes = (OBS + ACT, WIDTH), (WIDTH, WIDTH), (WIDTH, Dynamics.out_dim(OBS))

    def rand(*shape: int) -> Tensor:
        return torch.randn(MODEL_MEMBERS, *shape)

    layers = [(rand(MODEL_BATCH, n), rand(n, m), rand(MODEL_BATCH, m)) for n, m in sizes]

    def update() -> None:
        for k, (inputs, weights, grad) in enumerate(layers):
            torch.bmm(inputs, weights)
            torch.bmm(inputs.transpose(1, 2), grad)
            if k:  # nothing asks for the gradient of the first inputs
                torch.bmm(grad, weights.transpose(1, 2))

    return update


def rollout() -> Call:
    """One imagined step from `ROLLOUTS` replayed observations, all members asked, the least agreed fifth dropped."""
    ours = agent(layer_norm=False)
    return lambda: imagine(ROLLOUTS, ours.policy, ours.model, ours.buffer, ours.config, ours.imagination)


class PeerNetwork(Protocol):
    """mbrl-lib's ensemble."""

    def parameters(self) -> Iterator[nn.Parameter]:
        """Its weights."""
        ...

    def update(self, inputs: Tensor, optimizer: torch.optim.Optimizer, targets: Tensor) -> object:
        """Take one step."""
        ...


def peer_network(mbrl: ModuleType, **options: object) -> PeerNetwork:
    """mbrl-lib's ensemble of the size of ours."""
    return mbrl.GaussianMLP(OBS + ACT, OBS + 1, "cpu", num_layers=2, ensemble_size=MODEL_MEMBERS, hid_size=WIDTH, **options)


def peer_rollout(mbrl: ModuleType) -> Call:
    """The same number of steps of mbrl-lib's model, which asks one member for each, and none whether the episode ends."""
    ours, network = agent(layer_norm=False), peer_network(mbrl, propagation_method="random_model")
    model = mbrl.OneDTransitionRewardModel(network, target_is_delta=True, normalize=True, learned_rewards=True)

    def never(_: Tensor, observation: Tensor) -> Tensor:
        return torch.zeros(len(observation), 1, dtype=torch.bool)

    env = mbrl.ModelEnv(make_env(ENV), model, never, generator=torch.Generator())

    @torch.no_grad()
    def step() -> None:
        observation = ours.buffer.split(ours.buffer.sample((ROLLOUTS,), ours.imagination)).observation
        env.step(ours.policy(observation)[0].clamp(-1.0, 1.0), env.reset(observation.numpy(), return_as_np=False))

    return step


def peer_update(mbrl: ModuleType) -> Call:
    """One update of mbrl-lib's ensemble."""
    rows, ensemble = model_rows(), peer_network(mbrl, learn_logvar_bounds=False)
    optimizer = torch.optim.Adam(ensemble.parameters())
    return lambda: ensemble.update(rows[0], optimizer, rows[1])


def loop_update() -> Call:
    """One update of a plain loop over networks, if mbrl-lib is not installed."""
    rows, sizes = model_rows(), ((OBS + ACT, WIDTH), (WIDTH, WIDTH), (WIDTH, 2 * (OBS + 1)))
    networks = [nn.Sequential(*(layer for n, m in sizes for layer in (nn.Linear(n, m), nn.ReLU())))[:-1] for _ in rows[0]]
    optimizers = [torch.optim.Adam(network.parameters()) for network in networks]

    def loop() -> None:
        for network, optimizer, x, y in zip(networks, optimizers, *rows, strict=True):
            optimizer.zero_grad()
            mean, log_var = network(x).chunk(2, -1)
            nn.functional.gaussian_nll_loss(mean, y, log_var.exp()).backward()
            optimizer.step()

    return loop


def model_rows() -> tuple[Tensor, Tensor]:
    """Made-up inputs and targets of a model."""
    return torch.randn(MODEL_MEMBERS, MODEL_BATCH, OBS + ACT), torch.randn(MODEL_MEMBERS, MODEL_BATCH, OBS + 1)
