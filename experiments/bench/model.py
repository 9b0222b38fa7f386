"""The learnt model against mbrl-lib's: an update of the ensemble and an imagined step, in alternation within one run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from types import ModuleType
from typing import TYPE_CHECKING, Protocol

import torch
from torch import Tensor, nn

from experiments.bench import peers
from experiments.bench.dyna import ACT, ENV, FULL, OBS, TINY, WIDTH, agent
from experiments.bench.timing import compare
from transferkit.envs import make_env
from transferkit.nn import Dynamics
from transferkit.trainers.dyna.imagine import imagine
from transferkit.trainers.dyna.losses import dynamics_loss

if TYPE_CHECKING:
    from experiments.bench.dyna import Size

MODEL_BATCH, MODEL_MEMBERS, ROLLOUTS = 256, 5, 1280

Call = Callable[[], object]

__all__ = ["FULL", "TINY", "main"]


def main(size: Size) -> None:
    """Measure and print."""
    torch.set_num_threads(1)
    mbrl = peers.optional("mbrl.models")
    peer = {"mbrl-lib": peer_update(mbrl)} if mbrl else {"a loop over networks": loop_update()}
    compare(
        f"an update of an ensemble of {MODEL_MEMBERS}, {WIDTH}-{WIDTH}, batches of {MODEL_BATCH} (must be 1.5)",
        {"transferkit": model_update(compiles=size.compiles), **peer, "matrix products alone": model_products()},
        size.rounds,
    )
    if mbrl:
        calls = {"transferkit, one member a rollout": rollout(compiles=size.compiles, keep_share=1.0)}
        calls["transferkit, two, and the fifth on which they differ most dropped"] = rollout(
            compiles=size.compiles, keep_share=0.8
        )
        calls["mbrl-lib, one member a rollout"] = peer_rollout(mbrl)
        compare(f"{ROLLOUTS} imagined steps (must be 1.0)", calls, size.rounds)


def model_update(*, compiles: bool) -> Call:
    """One update of our ensemble."""
    ours = agent(layer_norm=False, compiles=compiles)
    batch = ours.buffer.split(ours.buffer.sample((MODEL_MEMBERS, MODEL_BATCH), ours.batches))

    target = ours.model.targets(batch.observation, batch.reward, batch.next_observation)
    learner, update = ours.model_learner, ours.programs.update_model
    rates = learner.optimizer.rates(1)[0]
    return lambda: update(learner, batch, target, rates, dynamics_loss)


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


def rollout(*, compiles: bool, keep_share: float) -> Call:
    """One imagined step, of which `ROLLOUTS` are kept; with a share below 1 two members are asked."""
    ours = agent(layer_norm=False, compiles=compiles)
    config, networks = replace(ours.config, keep_share=keep_share), (ours.policy, ours.model, ours.buffer)
    return lambda: imagine(
        ROLLOUTS, *networks, config, ours.imagination, members=MODEL_MEMBERS, step=ours.programs.imagined_step
    )


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
