"""Stable-Baselines3's zip files: PPO, A2C, SAC, TD3 and DDPG.

Weights are `policy.pth`. Of `data` only plain JSON is taken: the pickles in it are never opened, but for SBX's weights.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from transferkit.interop.archive import Archive
from transferkit.interop.foreign import Foreign, chain, linear, tensor
from transferkit.interop.names import known_activation
from transferkit.interop.torch_file import is_torch, read_torch
from transferkit.reading import FormatError, parse

if TYPE_CHECKING:
    from transferkit.interop.foreign import Layer

WEIGHTS, DATA, VERSION = "policy.pth", "data", "_stable_baselines3_version"


def is_sb3(archive: Archive) -> bool:
    """Whether a zip is one of Stable-Baselines3's, or of SBX's."""
    return DATA in archive.names and VERSION in archive.names


def read_sb3(archive: Archive) -> Foreign:
    """Read a policy.

    Raises:
        FormatError: it is damaged, or not a plain MLP with continuous actions.
    """
    data = parse(archive.read(DATA), dict[str, Any])
    version = archive.read(VERSION).decode("ascii", "replace")[:40].strip()
    if WEIGHTS not in archive.names:
        return _of_sbx(data)
    inner = Archive(archive.read(WEIGHTS))
    state = read_torch(inner) if is_torch(inner) else None
    if not isinstance(state, Mapping):
        raise FormatError(f"its {WEIGHTS} is not a state dict")
    _check(state, data)
    on_policy = "action_net.weight" in state
    return (_on_policy if on_policy else _off_policy)(state, data, f"Stable-Baselines3 {version}")


def _of_sbx(data: Mapping[str, Any]) -> Foreign:
    from transferkit.interop.sbx_file import activation_of, read_sbx  # noqa: PLC0415 - of few files

    _check({}, data)
    found = read_sbx(data)
    activation, usual = activation_of(found, data.get("policy_kwargs"))
    return replace(found, activation=activation, usual=usual, bounds=_bounds(data), steps=_steps(data))


def _check(state: Mapping[str, Any], data: Mapping[str, Any]) -> None:
    if extractors := [name for name in state if "features_extractor" in name]:
        raise FormatError(f"it has a feature extractor ({extractors[0]}); only plain MLPs are read")
    if data.get("use_sde") is True:
        raise FormatError("it explores by gSDE (use_sde), which is not read")
    space = data.get("observation_space")
    if isinstance(space, Mapping) and "Dict" in str(space.get(":type:")):
        raise FormatError("its observations are a dictionary; only flat ones are read")


def _on_policy(state: Mapping[str, Any], data: Mapping[str, Any], version: str) -> Foreign:
    if "log_std" not in state:
        raise FormatError("its actions are discrete; only continuous ones are read")
    body = [layer for part in ("shared_net", "policy_net") for layer in chain(state, f"mlp_extractor.{part}.")]
    return Foreign(
        f"{version} PPO or A2C",
        [*body, linear(state, "action_net")],
        _activation(data, "tanh"),
        1.0,
        bounds=_bounds(data),
        log_std=tensor(state, "log_std"),
        steps=_steps(data),
        usual=_is_usual(data),
        notes=["its critic values states alone and is left out"],
    )


def _off_policy(state: Mapping[str, Any], data: Mapping[str, Any], version: str) -> Foreign:
    gaussian = "actor.log_std.weight" in state
    layers = [*chain(state, "actor.latent_pi."), linear(state, "actor.mu")] if gaussian else chain(state, "actor.mu.")
    if not layers:
        raise FormatError("it has no actor of PPO, A2C, SAC, TD3 or DDPG")
    count = len({name.split(".")[1] for name in state if re.match(r"critic\.qf\d+\.", name)})
    return Foreign(
        f"{version} {'SAC' if gaussian else 'TD3 or DDPG'}",
        layers,
        _activation(data, "relu"),
        "bounds",
        bounds=_bounds(data),
        squash=True,
        critics=_critics(state, count),
        steps=_steps(data),
        usual=_is_usual(data),
    )


def _critics(state: Mapping[str, Any], count: int) -> list[list[Layer]]:
    return [chain(state, f"critic.qf{k}.") for k in range(count)]


def _is_usual(data: Mapping[str, Any]) -> bool:
    """Whether `policy_kwargs` leave the activation to the library."""
    kwargs = data.get("policy_kwargs")
    return isinstance(kwargs, Mapping) and "activation_fn" not in kwargs


def _activation(data: Mapping[str, Any], usual: str) -> str | None:
    """What `policy_kwargs` say in plain words beside their pickle."""
    kwargs = data.get("policy_kwargs")
    if _is_usual(data):
        return usual
    return known_activation(str(kwargs["activation_fn"])) if isinstance(kwargs, Mapping) else None


def _steps(data: Mapping[str, Any]) -> int:
    steps = data.get("num_timesteps")
    return steps if type(steps) is int and 0 <= steps <= 2**53 else 0


def _bounds(data: Mapping[str, Any]) -> tuple[float, float] | None:
    """The bounds of its actions, if they are written beside the pickle, as `[-1. -1.]`, and are the same for all."""
    space = data.get("action_space")
    if not isinstance(space, Mapping):
        return None
    try:
        (low,), (high,) = ({float(word) for word in str(space.get(end)).strip("[]").split()} for end in ("low", "high"))
    except ValueError:  # other words, or several bounds
        return None
    return low, high
