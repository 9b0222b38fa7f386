"""Replaying whole updates as CUDA graphs: hundreds of small kernels are started at once."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import Any, Generic, NamedTuple, TypeVar

import torch
from torch import Tensor

from transferkit.nn.learner import Learner

EAGER_CALLS = 3
"""Calls before a graph is captured, in which libraries set themselves up."""

R = TypeVar("R")


class _Graph(NamedTuple):
    graph: torch.cuda.CUDAGraph
    inputs: list[Tensor]
    result: Any


class Captured(Generic[R]):
    """A function of tensors on a CUDA device, gradients and in-place steps included, that is replayed once it is known.

    The kernels are the same as without, so the numbers are too. Tensors may stand in tuples; whatever else is an argument is
    part of what was captured, as are the parameters of a `Learner` that learn.
    """

    def __init__(self, function: Callable[..., R]) -> None:
        self.function = function
        self._calls: dict[Hashable, int] = {}
        self._graphs: dict[Hashable, _Graph] = {}

    def __call__(self, *args: Any, **kwargs: Any) -> R:  # noqa: ANN401 - the function's own
        """Call the function, as it is at first."""
        everything = (args, tuple(kwargs.values()))
        key = (_key(everything), *kwargs)
        if key not in self._graphs:
            self._calls[key] = self._calls.get(key, 0) + 1
            if self._calls[key] <= EAGER_CALLS:
                return self.function(*args, **kwargs)
            self._graphs[key] = self._capture(args, kwargs)
        graph, inputs, result = self._graphs[key]
        for own, given in zip(inputs, _tensors(everything), strict=True):
            own.copy_(given)
        graph.replay()
        return _copied(result)

    def _capture(self, args: tuple[Any, ...], kwargs: dict[str, Any]) -> _Graph:
        """Record the kernels of a call, without running them."""
        own_args = _copied(args)
        own_kwargs = dict(zip(kwargs, _copied(tuple(kwargs.values())), strict=True))
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            result = self.function(*own_args, **own_kwargs)
        return _Graph(graph, list(_tensors((own_args, tuple(own_kwargs.values())))), result)


def _key(value: Any) -> Hashable:  # noqa: ANN401 - any argument
    """What a graph depends on, of an argument."""
    if isinstance(value, Tensor):
        return value.shape, value.dtype
    if isinstance(value, tuple):
        return tuple(map(_key, value))
    return (value, *value.optimizer.learning) if isinstance(value, Learner) else value


def _tensors(value: Any) -> Iterator[Tensor]:  # noqa: ANN401
    if isinstance(value, Tensor):
        yield value
    elif isinstance(value, tuple):
        for one in value:
            yield from _tensors(one)


def _copied(value: Any) -> Any:  # noqa: ANN401
    """The same with tensors of its own."""
    if isinstance(value, Tensor):
        return value.clone()
    if isinstance(value, tuple):
        return getattr(type(value), "_make", tuple)(map(_copied, value))
    return value
