"""CleanRL's models: the state dicts of its continuous PPO, DDPG, TD3 and SAC, alone or in the tuple that its scripts write."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from transferkit.interop.foreign import Foreign, chain, linear, tensor
from transferkit.reading import FormatError

if TYPE_CHECKING:
    from transferkit.interop.foreign import Layer

PPO, HEADS = "actor_mean.0.weight", {"fc_mu": "TD3 or DDPG", "fc_mean": "SAC"}


def states_of(saved: object) -> list[Mapping[str, Any]]:
    """Take the state dicts of a file: one, or several in a tuple or a dictionary."""
    if not isinstance(saved, Mapping):
        inner = saved if isinstance(saved, list | tuple) else ()
    else:
        inner = [saved] if any(isinstance(value, Tensor) for value in saved.values()) else saved.values()
    return [state for state in inner if isinstance(state, Mapping)]


def is_cleanrl(saved: object) -> bool:
    """Whether a torch file holds an actor with CleanRL's names."""
    return any(_is_actor(state) for state in states_of(saved))


def read_cleanrl(saved: object) -> Foreign:
    """Read a policy, and its critics if they lie beside it.

    Raises:
        FormatError: its layers do not fit CleanRL's.
    """
    states = states_of(saved)
    actor = next(state for state in states if _is_actor(state))
    if PPO in actor:
        return _ppo(actor)
    head = next(name for name in HEADS if f"{name}.weight" in actor)
    scale, bias = (tensor(actor, f"action_{name}").flatten() for name in ("scale", "bias"))
    if bool((bias != 0).any()) or bool((scale != scale[:1]).any()) or not bool((scale > 0).all()):
        raise FormatError("its action_scale and action_bias are not the same for all actions, or not symmetric")
    critics = [_numbered(state, ()) for state in states if state is not actor and "fc1.weight" in state]
    return Foreign(
        f"CleanRL {HEADS[head]}",
        [*_numbered(actor, (head, "fc_logstd", "action_scale", "action_bias")), linear(actor, head)],
        "relu",
        1.0,
        squash=True,
        gain=float(scale[0]),
        normalized=False,
        critics=critics[:2],  # what lies behind them are target networks
        critic_actions=1.0,
        usual=True,
        notes=["takes observations as they are, as CleanRL's script does"],
    )


def _ppo(state: Mapping[str, Any]) -> Foreign:
    return Foreign(
        "CleanRL PPO",
        chain(state, "actor_mean."),
        "tanh",
        1.0,
        log_std=tensor(state, "actor_logstd").flatten(),
        usual=True,
        notes=["its critic values states alone and is left out"],
    )


def _numbered(state: Mapping[str, Any], beside: Sequence[str]) -> list[Layer]:
    """The layers `fc1`, `fc2`, ... with nothing unknown beside them."""
    names = {name.partition(".")[0] for name in state} - set(beside)
    if strange := [name for name in names if not re.fullmatch(r"fc\d+", name)]:
        raise FormatError(f"it has {min(strange)}; only CleanRL's plain MLPs are read")
    return [linear(state, name) for name in sorted(names, key=lambda name: int(name[2:]))]


def _is_actor(state: Mapping[str, Any]) -> bool:
    return PPO in state or any(isinstance(state.get(f"{name}.weight"), torch.Tensor) for name in HEADS)
