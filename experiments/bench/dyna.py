"""DYNA-DDPG's learning against peers and against its matrix products alone, in alternation within one run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import stable_baselines3
import torch
from torch import Tensor

from experiments.bench import peers
from experiments.bench.timing import compare
from transferkit.config import TrainConfig, with_settings
from transferkit.envs import VectorEnv, derive_spec, make_env
from transferkit.policy.critic_and_model import make_critic, make_dynamics
from transferkit.policy.make import new_policy
from transferkit.streams import Streams
from transferkit.trainers.dyna.agent import Agent
from transferkit.trainers.dyna.replay import Batch

ENV, OBS, ACT, WIDTH, BATCH, UPDATES, STEPS = "Hopper-v5", 11, 3, 128, 128, 20, 50

Call = Callable[[], object]


@dataclass(frozen=True)
class Size:
    """How much is measured."""

    rounds: int
    compiles: bool


FULL, TINY = Size(25, compiles=True), Size(1, compiles=False)


def main(size: Size) -> None:
    """Measure and print."""
    torch.set_num_threads(1)
    compiles = size.compiles
    compare(
        f"{UPDATES} updates of DDPG with two critics, {WIDTH}-{WIDTH}, batches of {BATCH}, actor every 2nd (must be 4 and 0.5)",
        {
            "transferkit with layer normalisation, compiled": agent(layer_norm=True, compiles=compiles).learn,
            "transferkit without": agent(layer_norm=False, compiles=compiles).learn,
            "transferkit with layer normalisation, eager": agent(layer_norm=True).learn,
            "stable-baselines3 TD3, without": peers.td3_updates(ENV, WIDTH, BATCH, UPDATES),
            "matrix products alone": products(),
        },
        size.rounds,
    )
    calls = {"transferkit with layer normalisation, compiled": steps(agent(layer_norm=True, compiles=compiles))}
    calls["stable-baselines3 TD3, without"] = peers.td3_steps(stable_baselines3, ENV, WIDTH, BATCH, UPDATES, STEPS)
    if sbx := peers.optional("sbx"):
        calls["SBX TD3 with layer normalisation"] = peers.td3_steps(sbx, ENV, WIDTH, BATCH, UPDATES, STEPS, layer_norm=True)
        calls["SBX TD3 without"] = peers.td3_steps(sbx, ENV, WIDTH, BATCH, UPDATES, STEPS)
    compare(f"{STEPS} environment steps with the same updates (must be 1.0 of SBX)", calls, size.rounds)


def steps(ours: Agent) -> Call:
    """Environment steps of our learner, each with acting, physics and updates."""
    envs = VectorEnv([make_env(ENV)], lambda *k: Streams(0).integer("environment", *k))
    observation = envs.reset()

    def call() -> None:
        nonlocal observation
        for _ in range(STEPS):
            step = envs.step(action := ours.explore(observation))
            ours.observe(observation, action, step)
            ours.learn()
            observation = step.observation

    return call


def agent(*, layer_norm: bool, compiles: bool = False) -> Agent:
    """Our learner with a buffer of made-up transitions."""
    settings = {"network.hidden": (WIDTH, WIDTH), "network.init_std": 1.0, "dyna.batch_size": BATCH}
    settings |= {"dyna.updates_per_step": UPDATES, "dyna.actor_every": 2, "dyna.layer_norm": layer_norm}
    settings |= {"model.layer_norm": layer_norm, "dyna.critics": 2, "dyna.drawn_critics": None, "dyna.mirror": False}
    config, streams = with_settings(TrainConfig(ENV, algo="dyna-ddpg"), settings), Streams(0)
    policy = new_policy(config, None)
    critic = make_critic(policy, config.dyna, config.network.hidden, streams.torch("critic"))
    model = make_dynamics(policy, derive_spec(ENV), config.model, streams.torch("model"))
    device = torch.device("cpu")
    options = {"time_step": 0.0, "compiles": compiles}
    ours = Agent(policy, critic, model, config.dyna, config.model, streams, device, **options)
    generator = streams.torch("transitions")
    for _ in range(2000):
        observation, following = torch.randn(2, OBS, generator=generator)
        action, reward = torch.rand(ACT, generator=generator) * 2 - 1, torch.randn((), generator=generator)
        ours.buffer.add(Batch(observation, action, reward, following, torch.zeros(())))
    return ours


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
