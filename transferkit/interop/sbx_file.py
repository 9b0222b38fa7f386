"""The policy in a zip of SBX: a pickle of objects of jax and flax, of which only arrays are taken and nothing runs."""

from __future__ import annotations

import base64
import binascii
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import torch

from transferkit.interop import arrays
from transferkit.interop.flax_file import foreign_of
from transferkit.interop.names import known_activation
from transferkit.interop.unpickle import Inert, unpickle
from transferkit.reading import FormatError

if TYPE_CHECKING:
    from transferkit.interop.foreign import Foreign

USUAL = {"SBX PPO": "tanh"}
"""Activation that SBX takes by itself; relu for all others."""

FUNCTION = re.compile(r"<function (\w+) at ")
"""How Python writes jax's functions, `<PjitFunction of <function silu at 0x...>>`; its relu says nothing."""

OTHERWISE = ("gelu",)
"""Functions of jax that are not torch's of the same name: this one is an approximation."""


def read_sbx(data: Mapping[str, Any]) -> Foreign:
    """Read a policy out of the zip's `data`, which leaves the activation to the library.

    Raises:
        FormatError: it holds none, is damaged, or is not a plain MLP.
    """
    policy = data.get("policy")
    text = policy.get(":serialized:") if isinstance(policy, Mapping) else None
    if not isinstance(text, str):
        raise FormatError("it has neither weights of Stable-Baselines3 nor a policy of SBX")
    try:
        blob = base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        raise FormatError("its policy is not base64") from None
    made = unpickle(blob, {**arrays.MAKERS, "jax._src.array._reconstruct_array": _array}, None)
    states = {name: _params(made, f"{name}_state") for name in ("actor", "qf")}
    return foreign_of({name: params for name, params in states.items() if params is not None})


def activation_of(foreign: Foreign, kwargs: object) -> tuple[str | None, bool]:
    """The activation that a zip's `policy_kwargs` say, and whether they leave it to SBX; None if it is not known."""
    if kwargs is None or (isinstance(kwargs, Mapping) and "activation_fn" not in kwargs):
        return USUAL.get(foreign.library, "relu"), True
    named = FUNCTION.search(str(kwargs["activation_fn"])) if isinstance(kwargs, Mapping) else None
    return (known_activation(named[1]) if named and named[1] not in OTHERWISE else None), False


def _params(policy: object, name: str) -> object:
    """Parameters of a train state, as tensors."""
    state = policy.state.get(name) if isinstance(policy, Inert) else None
    return _tensors(state.state.get("params")) if isinstance(state, Inert) else None


def _tensors(value: object) -> object:
    if isinstance(value, arrays.Array) and value.value is not None:
        return torch.from_numpy(value.value.copy())
    inner = value.state.get("_dict") if isinstance(value, Inert) else value  # flax's FrozenDict
    return {key: _tensors(one) for key, one in inner.items()} if isinstance(inner, Mapping) else None


def _array(_make: object, _arguments: object, state: object = None, *_: object) -> arrays.Array:
    """A jax array, whose state is numpy's."""
    array = arrays.Array()
    array.__setstate__(state)
    return array
