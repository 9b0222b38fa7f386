"""Finished runs as cores: what a run trained, with its statistics, critics and model."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from transferkit.config import TrainConfig
from transferkit.envs import derive_spec, id_from_file
from transferkit.errors import EnvironmentContractError, RunDirectoryError, UnknownNameError
from transferkit.files import damaged_run
from transferkit.nn import Dynamics
from transferkit.policy.base import ScratchPolicy
from transferkit.policy.blueprints import MOST_NESTED, nested
from transferkit.policy.composed import ComposedNet
from transferkit.policy.core import Core, stack_members
from transferkit.policy.paper import PaperSandwich
from transferkit.policy.sandwich import Sandwich
from transferkit.policy.saved import load_components, load_policy, policy_file
from transferkit.reading import FormatError
from transferkit.run import finished_result, read_made_of, read_record
from transferkit.tensors import check_enough

if TYPE_CHECKING:
    from transferkit.nn import PolicyNet
    from transferkit.policy.base import Policy
    from transferkit.policy.saved import Component
    from transferkit.spec import IOSpec


def core_of_run(run: Path, env: str | None = None, *, best: bool = False) -> Core:
    """Take a finished run as a core of one member.

    Its network is what the run trained: a plain network, or the whole policy that was trained around another core.

    Args:
        run: its directory, whose name is the core's id, with `-best` added for the best.
        env: an environment that the user named, so that the run's record may name it, too, with a module to import.
        best: the best policy that its evaluations found, instead of the final one.

    Raises:
        RunDirectoryError: it is not finished, is damaged, or holds nothing that a core can be made of.
        EnvironmentContractError: the environment needs a module to be imported, and is not named.
    """
    if finished_result(run) is None:
        raise RunDirectoryError(f"run {run} is not finished, so it is not a core yet", remedy="finish it with {resume=True}")
    config, policy = TrainConfig.from_json(read_record(run)), load_policy(run, best=best)
    network, spec, file = _network(policy, run), _spec(policy, config, run, env), policy_file(run, best=best)
    components = {"policy": stack_members([network.state_dict()])}
    if policy.normalizer is not None:
        components["normalizer"] = stack_members([policy.normalizer.state_dict()])
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    core = Core(run.resolve().name + ("-best" if best else ""), spec, network.architecture, (config.seed,), components, digest)
    absolute = config.model.predict == "state"  # a model that no core takes
    beside = {name: part for name, part in load_components(run, best=best).items() if name == "critic" or not absolute}
    with damaged_run(file):
        return _with_ensembles(core, beside)


def _network(policy: Policy, run: Path) -> PolicyNet | ComposedNet:
    if isinstance(policy, ScratchPolicy):
        return policy.network
    if not isinstance(policy, Sandwich | PaperSandwich):
        raise RunDirectoryError(f"run {run} trained a policy without a network, which is not a core", remedy="name another run")
    network = ComposedNet(policy)
    if nested(network.architecture.to_json()) > MOST_NESTED:
        raise RunDirectoryError(
            f"run {run} is the last of more than {MOST_NESTED} runs, each around the one before, and is not a core",
            remedy="start anew",
        )
    return network


def kept_spec(policy: Policy, record: Mapping[str, Any]) -> IOSpec | None:
    """What a run's numbers mean, as its policy or its record says; None if an earlier version kept nothing."""
    if isinstance(policy, Sandwich | PaperSandwich):
        return replace(policy.target, hold=policy.hold)
    return read_made_of(record).spec


def _spec(policy: Policy, config: TrainConfig, run: Path, env: str | None) -> IOSpec:
    """What a run's numbers mean: as it says, or derived from its environment."""
    if kept := kept_spec(policy, read_record(run)):
        return kept
    env_id = id_from_file(config.env, run, env)
    try:
        spec = derive_spec(env_id)
    except (UnknownNameError, EnvironmentContractError):
        raise RunDirectoryError(
            f"run {run} was trained in '{env_id}', which is not an environment that can be made by its id",
            remedy="register it first",
        ) from None
    if (spec.obs_dim, spec.act_dim) != (policy.obs_dim, policy.act_dim):
        raise RunDirectoryError(
            f"run {run} takes {policy.obs_dim} observations and {policy.act_dim} actions, its environment {config.env} has "
            f"{spec.obs_dim} and {spec.act_dim}",
            remedy="restore the environment",
        )
    return spec


def _with_ensembles(core: Core, beside: dict[str, Component]) -> Core:
    """Add the critics and the model, once they fit the core."""
    width, outputs = core.spec.obs_dim + core.spec.act_dim, {"critic": 1, "dynamics": Dynamics.out_dim(core.spec.obs_dim)}
    for name, (architecture, weights) in beside.items():
        if (architecture.in_dim, architecture.out_dim) != (width, outputs.get(name)):
            raise FormatError(f"its {name} has {architecture.in_dim} inputs and {architecture.out_dim} outputs")
        check_enough(weights.values(), architecture.weights, f"its {name}")
    stacked = {name: stack_members([weights]) for name, (_, weights) in beside.items()}
    ensembles = {name: architecture for name, (architecture, _) in beside.items()}
    core = replace(core, components={**core.components, **stacked}, ensembles=ensembles)
    for name in ensembles:
        getattr(core, name)()
    return core
