"""Records of earlier versions as records of this one.

Until version 0.2 a record had no `network`: the trainers' sections held the network's settings, PPO's the environment's, and
DYNA-DDPG's those of the model and of DYNA-PPO.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_NETWORK = ("hidden", "activation", "normalize_observation")
_MODEL = ("members", "hidden", "learning_rate", "every", "updates", "batch_size", "loss")


def migrated(data: Mapping[str, Any]) -> dict[str, Any]:
    """A record's configuration in today's form; one that has it already is copied."""
    if "network" in data:
        return dict(data)
    ppo, dyna, wrap = dict(data["ppo"]), dict(data.get("dyna", {})), dict(data.get("wrap", {}))
    algo = data["algo"]
    sections = {
        "env_config": {"clip_actions": ppo.pop("clip_actions", True)},
        "network": _network(algo, ppo, dyna),
        "model": _model(dyna),
        "dyna_ppo": {name: dyna.pop(f"ppo_{name}") for name in ("rollouts", "horizon", "updates") if f"ppo_{name}" in dyna},
        "wrap": _wrap(wrap, ppo, dyna),
    }
    if algo == "dyna-ppo" and "buffer_size" in dyna:
        sections["dyna_ppo"]["buffer_size"] = dyna["buffer_size"]
    for name in ("hidden", "activation", "std", "init_std", "normalize_observation"):
        ppo.pop(name, None)
    sections |= {"ppo": _ppo(algo, ppo), "dyna": dyna}
    return {**data, **sections}


def migrated_blueprint(blueprint: Mapping[str, Any]) -> dict[str, Any]:
    """A policy's blueprint in today's form: a head for the log-std used to imply the paper's initialisation."""
    architecture = blueprint.get("architecture", {})
    if architecture.get("std") != "head" or architecture["initialization"] != "orthogonal":
        return dict(blueprint)
    return {**blueprint, "architecture": {**architecture, "initialization": "paper"}}


def _network(algo: str, ppo: Mapping[str, Any], dyna: dict[str, Any]) -> dict[str, Any]:
    std, init_std = ppo.get("std", "parameter"), ppo.get("init_std", 0.6)
    settings = {name: ppo[name] for name in _NETWORK} | {"std": std, "init_std": init_std}
    settings["initialization"] = "paper" if std == "head" else "orthogonal"
    own = {name: dyna.pop(name) for name in (*_NETWORK, "squash", "initialization") if name in dyna}
    if algo == "dyna-ddpg":
        settings |= {"std": "parameter", "init_std": dyna["exploration_noise"] or 1.0, "initialization": "orthogonal"} | own
    return settings


def _model(dyna: dict[str, Any]) -> dict[str, Any]:
    settings = {name: dyna.pop(f"model_{name}") for name in _MODEL if f"model_{name}" in dyna}
    settings |= {name: dyna.pop(name) for name in ("predict", "normalize_targets") if name in dyna}
    return settings | ({"layer_norm": dyna["layer_norm"]} if "layer_norm" in dyna else {})


def _wrap(wrap: dict[str, Any], ppo: Mapping[str, Any], dyna: dict[str, Any]) -> dict[str, Any]:
    moved = {"critic": "wrap_critic", "dynamics": "wrap_dynamics"}
    settings = {name: dyna.pop(old) for name, old in moved.items() if old in dyna}
    return wrap | settings | {"init_std": ppo.get("init_std", 0.6)}


def _ppo(algo: str, ppo: dict[str, Any]) -> dict[str, Any]:
    """Without what had no effect; DYNA-PPO replaced the schedule by KL divergence and the critic's own rate."""
    settings = {"critic_learning_rate": None, **ppo}
    if algo == "dyna-ppo":
        schedule = "linear" if settings["schedule"] == "adaptive" else settings["schedule"]
        settings |= {"rollout": "steps", "schedule": schedule, "critic_learning_rate": None}
    return {name: value for name, value in settings.items() if name != "desired_kl" or settings["schedule"] == "adaptive"}
