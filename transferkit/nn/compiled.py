"""Compiling whole updates with `torch.compile`."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable
from typing import ParamSpec, TypeVar

import torch
from torch import Tensor

from transferkit.files import user_folder
from transferkit.versions import cpp_compiler

TRACING = {
    "trace_autograd_ops": True,
    "capture_scalar_outputs": True,
    "recompile_limit": 10_000,  # a process may train any number of policies
    "accumulated_recompile_limit": 10_000,
}
"""Settings of `torch._dynamo.config` under which whole updates can be traced."""

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function of tensors of fixed shapes, gradients and in-place steps included, when it is first called.

    The kernels are called from C++, which takes less time between them and to start. What was compiled is kept in the user's
    cache folder (`TORCHINDUCTOR_CACHE_DIR`).
    """
    os.environ.setdefault("TORCHINDUCTOR_CACHE_DIR", str(user_folder("XDG_CACHE_HOME", ".cache") / "torchinductor"))
    options: dict[str, str | int | bool | Callable[..., object]] = {"cpp_wrapper": True}
    inner = torch.compile(function, fullgraph=True, dynamic=False, options=options)

    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        import torch._dynamo  # noqa: PLC0415 - takes seconds, and most runs do without

        with torch._dynamo.config.patch(**TRACING):  # noqa: SLF001 - its documented name
            return inner(*args, **kwargs)

    return call


def mark_varying(tensors: Iterable[Tensor]) -> None:
    """Let the first axis of tensors vary from call to call of a compiled function, without compiling it anew."""
    import torch._dynamo  # noqa: PLC0415

    for tensor in tensors:
        torch._dynamo.mark_dynamic(tensor, 0)  # noqa: SLF001 - its documented name


def cannot_compile() -> str | None:
    """Compile a tiny update; returns in one line why that fails, if it does."""
    if cpp_compiler() is None:
        return "there is no C++ compiler"
    return _failure()


@functools.cache
def _failure() -> str | None:
    try:
        weight = compiled(_tiny_update)(torch.ones(4))
    except Exception as error:  # of torch, of the compiler or of the linker
        return next(filter(None, str(error).splitlines()), type(error).__name__)
    return None if torch.equal(weight, torch.full((4,), -1.0)) else "a compiled update gives wrong numbers"


def _tiny_update(weight: Tensor) -> Tensor:
    weight = weight.detach().requires_grad_()
    (gradient,) = torch.autograd.grad(weight.square().sum(), weight)
    return weight.detach() - gradient
