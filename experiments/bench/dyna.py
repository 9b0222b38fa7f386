"""`make bench`: DYNA-DDPG's updates against peers and against its matrix products alone, in alternation within one run."""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before torch

import importlib.util
import statistics
import time
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from torch import nn

from transferkit.config import DynaConfig
from transferkit.dyna import Batch
from transferkit.dyna.agent import Agent
from transferkit.dyna.imagine import imagine
from transferkit.dyna.losses import dynamics_loss
from transferkit.envs import derive_spec, make_env
from transferkit.nn import Architecture
from transferkit.nn.dynamics import Dynamics
from transferkit.policy import ScratchPolicy
from transferkit.policy.parts import make_critic, make_dynamics
from transferkit.run import Streams

ENV, OBS, ACT, WIDTH, BATCH, UPDATES = "Hopper-v5", 11, 3, 128, 128, 20
ROUNDS = 25
MODEL_BATCH, MODEL_MEMBERS, ROLLOUTS = 256, 5, 1280


def agent(*, layer_norm: bool) -> Agent:
    """Our learner with a buffer of made-up transitions."""
    config = DynaConfig(
        hidden=(WIDTH, WIDTH), batch_size=BATCH, updates_per_step=UPDATES, actor_every=2, layer_norm=layer_norm, model_share=0.0
    )
    streams = Streams(0)
    architecture = Architecture(OBS, ACT, (WIDTH, WIDTH), "relu")
    policy = ScratchPolicy.create(architecture, streams.torch("policy"), init_std=1.0, normalize=True)
    model = make_dynamics(policy, derive_spec(ENV), config, streams.torch("model"))
    ours = Agent(policy, make_critic(policy, config, streams.torch("critic")), model, config, streams, torch.device("cpu"))
    generator = streams.torch("transitions")
    for _ in range(2000):
        observation, following = torch.randn(2, OBS, generator=generator)
        action, reward = torch.rand(ACT, generator=generator) * 2 - 1, torch.randn((), generator=generator)
        ours.buffer.add(Batch(observation, action, reward, following, torch.zeros(())))
    return ours


def td3() -> Callable[[], None]:
    """stable-baselines3's TD3 on the same number of updates."""
    import gymnasium  # noqa: PLC0415
    from stable_baselines3 import TD3  # noqa: PLC0415
    from stable_baselines3.common.logger import Logger  # noqa: PLC0415

    model = TD3("MlpPolicy", gymnasium.make(ENV), batch_size=BATCH, policy_delay=2, policy_kwargs={"net_arch": [WIDTH, WIDTH]})
    model.set_logger(Logger(None, []))
    assert model.replay_buffer is not None
    rng = np.random.default_rng(0)
    for _ in range(2000):
        observation, following = rng.normal(size=(2, 1, OBS)).astype(np.float32)
        action = rng.uniform(-1, 1, (1, ACT)).astype(np.float32)
        model.replay_buffer.add(observation, following, action, rng.normal(size=1), np.zeros(1), [{}])
    return lambda: model.train(gradient_steps=UPDATES, batch_size=BATCH)


def products() -> Callable[[], None]:
    """The matrix products of a step's updates and nothing else."""
    w, generator = WIDTH, torch.Generator().manual_seed(0)
    rand = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    inputs, hidden, grad = rand(2, BATCH, OBS + ACT), rand(2, BATCH, w), rand(2, BATCH, w)
    first, second = rand(2, OBS + ACT, w), rand(2, w, w)
    wide, big = rand(UPDATES * BATCH, w), rand(2, UPDATES * BATCH, w)

    def critic() -> None:
        torch.bmm(inputs, first), torch.bmm(hidden, second)
        (
            torch.bmm(hidden.transpose(1, 2), grad),
            torch.bmm(grad, second.transpose(1, 2)),
            torch.bmm(inputs.transpose(1, 2), grad),
        )

    def actor() -> None:
        torch.bmm(inputs, first), torch.bmm(hidden, second), torch.bmm(grad, second.transpose(1, 2))
        torch.bmm(grad, first.transpose(1, 2))
        hidden[0] @ second[0], hidden[0].T @ grad[0], grad[0] @ second[0].T

    def step() -> None:
        wide @ second[0], torch.bmm(big, second)
        for k in range(UPDATES):
            critic()
            if k % 2 == 0:
                actor()

    return step


def model_update() -> Callable[[], None]:
    """One update of our ensemble."""
    ours = agent(layer_norm=False)
    batch = ours.buffer.split(ours.buffer.sample((MODEL_MEMBERS, MODEL_BATCH), ours.batches))

    def update() -> None:
        ours.model_optimizer.zero_grad()
        dynamics_loss(ours.model, batch).backward()
        ours.model_optimizer.step()

    return update


def model_products() -> Callable[[], None]:
    """The matrix products of one update of the ensemble and nothing else."""
    sizes = (OBS + ACT, WIDTH), (WIDTH, WIDTH), (WIDTH, Dynamics.out_dim(OBS))
    rand = lambda *shape: torch.randn(MODEL_MEMBERS, *shape)  # noqa: E731
    layers = [(rand(MODEL_BATCH, n), rand(n, m), rand(MODEL_BATCH, m)) for n, m in sizes]

    def update() -> None:
        for k, (inputs, weights, grad) in enumerate(layers):
            torch.bmm(inputs, weights), torch.bmm(inputs.transpose(1, 2), grad)
            if k:  # nothing asks for the gradient of the first inputs
                torch.bmm(grad, weights.transpose(1, 2))

    return update


def rollout() -> Callable[[], None]:
    """One imagined step from `ROLLOUTS` replayed observations, all members asked, the least agreed fifth dropped."""
    ours = agent(layer_norm=False)

    def step() -> None:
        imagine(ROLLOUTS, ours.policy, ours.model, ours.buffer, ours.config, ours.imagination)

    return step


def peer_network(**options: object) -> Any:  # noqa: ANN401 - of a package that may be missing
    """mbrl-lib's ensemble of the size of ours."""
    from mbrl.models import GaussianMLP  # type: ignore[import-not-found] # noqa: PLC0415

    return GaussianMLP(OBS + ACT, OBS + 1, "cpu", num_layers=2, ensemble_size=MODEL_MEMBERS, hid_size=WIDTH, **options)


def peer_rollout() -> Callable[[], None]:
    """The same number of steps of mbrl-lib's model, which asks one member for each, and none whether the episode ends."""
    from mbrl.models import ModelEnv, OneDTransitionRewardModel  # type: ignore[import-not-found] # noqa: PLC0415

    ours = agent(layer_norm=False)
    network = peer_network(propagation_method="random_model")
    model = OneDTransitionRewardModel(network, target_is_delta=True, normalize=True, learned_rewards=True)
    never = lambda action, observation: torch.zeros(len(observation), 1, dtype=torch.bool)  # noqa: E731
    env = ModelEnv(make_env(ENV), model, never, generator=torch.Generator())

    @torch.no_grad()
    def step() -> None:
        observation = ours.buffer.split(ours.buffer.sample((ROLLOUTS,), ours.imagination)).observation
        env.step(ours.policy(observation)[0].clamp(-1.0, 1.0), env.reset(observation.numpy(), return_as_np=False))

    return step


def peer_model_update() -> tuple[str, Callable[[], None]]:
    """One update of mbrl-lib's ensemble where it is installed, else of a plain loop over networks."""
    rows = torch.randn(MODEL_MEMBERS, MODEL_BATCH, OBS + ACT), torch.randn(MODEL_MEMBERS, MODEL_BATCH, OBS + 1)
    if importlib.util.find_spec("mbrl"):
        ensemble = peer_network(learn_logvar_bounds=False)
        optimizer = torch.optim.Adam(ensemble.parameters())
        return "mbrl-lib", lambda: ensemble.update(rows[0], optimizer, rows[1])
    sizes = (OBS + ACT, WIDTH), (WIDTH, WIDTH), (WIDTH, 2 * (OBS + 1))
    networks = [nn.Sequential(*(layer for n, m in sizes for layer in (nn.Linear(n, m), nn.ReLU())))[:-1] for _ in rows[0]]
    optimizers = [torch.optim.Adam(network.parameters()) for network in networks]

    def loop() -> None:
        for network, optimizer, x, y in zip(networks, optimizers, *rows, strict=True):
            optimizer.zero_grad()
            mean, log_var = network(x).chunk(2, -1)
            nn.functional.gaussian_nll_loss(mean, y, log_var.exp()).backward()
            optimizer.step()

    return "a loop over networks", loop


def seconds(function: Callable[[], None]) -> float:
    """Of one call."""
    started = time.perf_counter()
    function()
    return time.perf_counter() - started


def compare(title: str, functions: dict[str, Callable[[], None]]) -> None:
    """Time the functions in turns and print each one's ratio to the first."""
    for function in functions.values():
        function()
    rounds = [{name: seconds(function) for name, function in functions.items()} for _ in range(ROUNDS)]
    base = next(iter(functions))
    print(title)
    for name in functions:
        ratios = sorted(times[name] / times[base] for times in rounds)
        milliseconds = 1e3 * statistics.median(times[name] for times in rounds)
        low, high = ratios[len(ratios) // 10], ratios[-1 - len(ratios) // 10]
        print(f"  {name}: {milliseconds:.1f} ms, {statistics.median(ratios):.2f} times ours ({low:.2f} to {high:.2f})")


def main() -> None:
    """Run and print."""
    warnings.simplefilter("ignore")
    torch.set_num_threads(1)
    plain, normalised = agent(layer_norm=False), agent(layer_norm=True)
    compare(
        f"{UPDATES} updates of DDPG with two critics, {WIDTH}-{WIDTH}, batches of {BATCH}, actor every 2nd (must be 1.5)",
        {
            "transferkit": plain.learn,
            "transferkit with layer normalisation, its default": normalised.learn,
            "stable-baselines3 TD3": td3(),
            "matrix products alone": products(),
        },
    )
    name, peer = peer_model_update()
    compare(
        f"an update of an ensemble of {MODEL_MEMBERS}, {WIDTH}-{WIDTH}, batches of {MODEL_BATCH} (must be 3)",
        {"transferkit": model_update(), name: peer, "matrix products alone": model_products()},
    )
    if importlib.util.find_spec("mbrl"):
        compare(f"{ROLLOUTS} imagined steps (must be 3)", {"transferkit": rollout(), "mbrl-lib": peer_rollout()})


if __name__ == "__main__":
    main()
