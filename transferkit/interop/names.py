"""Activations by the names that libraries give them."""

from __future__ import annotations

import re

from transferkit.errors import UnknownNameError
from transferkit.nn import ACTIVATIONS

OTHER = {"lrelu": "leaky_relu", "leakyrelu": "leaky_relu", "swish": "silu"}


def known_activation(name: str) -> str | None:
    """Take a name such as `<class 'torch.nn.modules.activation.ReLU'>`; None if it is not one of ours."""
    last = re.sub(r"\W+$", "", name).rpartition(".")[2].lower()
    last = OTHER.get(last, last)
    return last if last in ACTIVATIONS else None


def check_activation(name: str) -> str:
    """Check what a user says.

    Raises:
        UnknownNameError: no network of ours has it.
    """
    known = known_activation(name)
    if known is None:
        raise UnknownNameError("activation", name, sorted(ACTIVATIONS))
    return known
