"""Policies as configurations describe them, and what finished runs hold: policy, critics and model."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from transferkit.config import TrainConfig
from transferkit.envs import make_env
from transferkit.errors import RunDirectoryError
from transferkit.evaluation import Evaluation, evaluate
from transferkit.nn import Architecture, Critic, Ensemble, EnsembleArchitecture, JointInput, StateCritic, Value
from transferkit.policy import Policy, ScratchPolicy, build, wrap
from transferkit.policy.core import Core
from transferkit.policy.parts import make_critic
from transferkit.run.directory import POLICY, RECORD, read_json
from transferkit.run.files import load_state
from transferkit.run.streams import Streams
from transferkit.zoo.artifact import load_core


def new_policy(config: TrainConfig, core: Core | None) -> Policy:
    """The untrained policy of a run: around a core, or from scratch."""
    if core is not None:
        return wrap(core, config.env, config=config.wrap, member=config.member, seed=config.seed, init_std=config.ppo.init_std)
    env = make_env(config.env)
    assert env.observation_space.shape is not None
    assert env.action_space.shape is not None
    dims = env.observation_space.shape[0], env.action_space.shape[0]
    env.close()
    generator = Streams(config.seed).torch("policy initialisation")
    ppo, dyna = config.ppo, config.dyna
    if config.algo != "dyna-ddpg":
        architecture = Architecture(*dims, ppo.hidden, ppo.activation, ppo.std)
        return ScratchPolicy.create(architecture, generator, init_std=ppo.init_std, normalize=ppo.normalize_observation)
    architecture = Architecture(*dims, dyna.hidden, dyna.activation, initialization=dyna.initialization, squash=dyna.squash)
    return ScratchPolicy.create(
        architecture, generator, init_std=dyna.exploration_noise or 1.0, normalize=dyna.normalize_observation
    )


def as_saved(policy: Policy) -> Policy:
    """A copy with memory of its own, as `load_policy` makes it.

    Training keeps the weights as views of one buffer, and their alignment changes the last bits of an action.
    """
    copy = build(policy.blueprint())
    copy.load_state_dict(policy.state_dict())
    return copy


def state_of(policy: Policy, parts: Mapping[str, nn.Module]) -> dict[str, Any]:
    """A trained policy and what was trained beside it, as `load_policy`, `load_parts` and `load_value` read them."""
    beside = {name: {"architecture": _architecture(part), "weights": _weights(part)} for name, part in parts.items()}
    return {"blueprint": policy.blueprint(), "weights": _weights(policy), "parts": beside}


def _architecture(part: nn.Module) -> dict[str, Any] | None:
    """Of an ensemble that wraps nothing."""
    ensemble = getattr(part, "ensemble", None)
    return ensemble.architecture.to_json() if isinstance(ensemble, Ensemble) else None


def _weights(module: nn.Module) -> dict[str, Tensor]:
    return {name: tensor.cpu() for name, tensor in module.state_dict().items()}


def load_policy(run_dir: str | Path) -> Policy:
    """The final policy of a finished run, with its normaliser.

    Raises:
        RunDirectoryError: the run is not finished, or its policy file is damaged.
    """
    path = Path(run_dir) / POLICY
    if not path.exists():
        raise RunDirectoryError(f"{run_dir} holds no finished run; finish it with `transferkit train ... --resume`")
    state = load_state(path)
    try:
        policy = build(state["blueprint"])
        policy.load_state_dict(state["weights"])
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        reason = " ".join(str(error).split())[:200]
        raise RunDirectoryError(f"{path} holds no policy of this version ({reason}); train again") from None
    return policy


def load_parts(run_dir: str | Path) -> dict[str, tuple[EnsembleArchitecture, dict[str, torch.Tensor]]]:
    """What a finished run trained from scratch beside its policy for a core to keep: `critic` and `dynamics`, or nothing."""
    saved = load_state(Path(run_dir) / POLICY)["parts"]
    return {
        name: (EnsembleArchitecture.from_json(part["architecture"]), part["weights"])
        for name, part in saved.items()
        if part["architecture"]
    }


def load_value(run_dir: str | Path, policy: Policy) -> Value | None:
    """What a finished run's critics think of its policy's actions, in their scale.

    None where it kept no critic, or wrapped one for a policy that it was given ready made.

    Raises:
        RunDirectoryError: a wrapped critic cannot be rebuilt, because its core is not what it was.
    """
    parts, record = load_state(Path(run_dir) / POLICY)["parts"], read_json(Path(run_dir) / RECORD)["config"]
    config = TrainConfig.from_json(record)
    if "value" in parts:
        critic = StateCritic(policy.obs_dim, config.ppo.hidden, config.ppo.activation, normalizer=policy.normalizer)
        critic.load_state_dict(parts["value"]["weights"])
        return lambda observation, _: critic.value(observation).squeeze(-1)
    if "critic" not in parts:
        return None
    architecture = parts["critic"]["architecture"]
    if architecture:
        critics = Critic(JointInput(policy.normalizer), Ensemble(EnsembleArchitecture.from_json(architecture)))
    elif config.core is None:
        return None
    else:
        core = load_core(config.core)
        if core.digest != record["core_digest"]:
            raise RunDirectoryError(f"core {config.core} is no longer the one that {run_dir} was trained with; restore it")
        rebuilt = new_policy(config, core)
        rebuilt.load_state_dict(policy.state_dict())
        critics = make_critic(rebuilt, config.dyna, Streams(0).torch("critic"))
    critics.load_state_dict(parts["critic"]["weights"])
    return critics.value


def evaluate_run(run_dir: str | Path, *, episodes: int = 20, seed: int = 0) -> Evaluation:
    """Evaluate the final policy of a run on its own environment."""
    config = read_json(Path(run_dir) / RECORD)["config"]
    policy = load_policy(run_dir)
    return evaluate(policy, config["env"], episodes=episodes, seed=seed, clip_actions=config["ppo"]["clip_actions"])
