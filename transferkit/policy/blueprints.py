"""Blueprints of policies: JSON from which a policy is built before its weights are loaded, without running code of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from transferkit.config.wrap import PAPER_WRAP, Adapter, Tap, WrapConfig
from transferkit.matching import Match, earlier_match, padded
from transferkit.nn import Architecture, Normalizer, PolicyNet
from transferkit.policy.base import ConstantPolicy, ScratchPolicy
from transferkit.policy.composed import ComposedNet
from transferkit.policy.paper import PaperSandwich
from transferkit.policy.sandwich import Sandwich
from transferkit.reading import Count, FormatError, Size, typed
from transferkit.spec import IOSpec

if TYPE_CHECKING:
    import torch

    from transferkit.policy.base import Policy

SEEDED = ("input_adapter", "output_adapter", "residual")
"""Parts of a sandwich that draw their first weights."""

MOST_NESTED = 8
"""Runs around runs; a blueprint that is nested much deeper is no longer read."""


@dataclass(frozen=True)
class Constant:
    """Blueprint of a `ConstantPolicy`."""

    obs_dim: Size
    act_dim: Size

    @property
    def weights(self) -> int:
        """Numbers in its matrices."""
        return self.act_dim

    def build(self) -> Policy:
        """Build it with zero weights."""
        return ConstantPolicy(self.obs_dim, self.act_dim)


@dataclass(frozen=True)
class Scratch:
    """Blueprint of a `ScratchPolicy`."""

    architecture: Architecture
    normalize: bool

    @property
    def weights(self) -> int:
        """Numbers in its matrices."""
        return self.architecture.weights

    def build(self) -> Policy:
        """Build it with zero weights."""
        return ScratchPolicy.create(self.architecture, None, init_std=1.0, normalize=self.normalize)


@dataclass(frozen=True)
class Paper:
    """Blueprint of a `PaperSandwich`."""

    core: dict[str, Any]
    """An `Architecture`, or the blueprint of a policy that was trained around a core of its own."""
    source: IOSpec
    target: IOSpec

    @property
    def weights(self) -> int:
        """Numbers in its matrices."""
        return _network(self.core).weights

    @property
    def feature_dim(self) -> int:
        """Width of what a sandwich around it takes."""
        return 2 * self.source.act_dim

    def build(self, generator: torch.Generator | None = None, *, init_std: float = 1.0) -> PaperSandwich | Sandwich:
        """Build it with zero weights, or with those of a new one."""
        core = build_network(self.core, generator, init_std=init_std)
        return PaperSandwich(core, (self.source, self.target), PAPER_WRAP, _generators(generator))


@dataclass(frozen=True)
class Sandwiched(Paper):
    """Blueprint of a `Sandwich`."""

    source_normalizer: bool
    tap: Tap
    adapter: Adapter
    finetune: bool
    residual: Count
    match: Match | None = None
    """What its adapters began with; earlier versions did not keep it."""

    @property
    def weights(self) -> int:
        """Numbers in its matrices."""
        source, target = self.source.obs_dim, self.target
        beside = self.finetune * (source**2 + self._tapped**2) + self.residual * (target.obs_dim + target.act_dim)
        ends = self._copies * (source * target.obs_dim + self._tapped * target.act_dim)
        return _network(self.core).weights + beside + ends

    @property
    def feature_dim(self) -> int:
        """Width of what a sandwich around it takes."""
        return self._copies * self._tapped + self.residual

    @property
    def _copies(self) -> int:
        return 1 if self.match is None else self.match.copies

    @property
    def _tapped(self) -> int:
        return _network(self.core).feature_dim if self.tap == "features" else self.source.act_dim

    def build(self, generator: torch.Generator | None = None, *, init_std: float = 1.0) -> PaperSandwich | Sandwich:
        """Build it with zero weights, or with those of a new one."""
        config = WrapConfig(
            tap=self.tap, adapter=self.adapter, finetune=self.finetune, residual=self.residual, lr_scale={}, init_std=init_std
        )
        core = build_network(self.core, generator, init_std=init_std)
        clip = isinstance(core, PolicyNet)  # what is composed clips by itself
        normalizer = Normalizer(self.source.obs_dim, clip=clip) if self.source_normalizer else None
        specs = self.source, self.target
        return Sandwich(core, normalizer, specs, config, self.matched(), _generators(generator))

    def matched(self) -> Match | None:
        """Take the match that was kept, or make it as earlier versions did.

        Raises:
            FormatError: it does not fit the specs.
        """
        if self.adapter == "random":
            return None
        if self.match is None:
            return padded(self.source, self.target) if self.adapter == "pad" else earlier_match(self.source, self.target)
        if not self.match.fits(self.source, self.target):
            raise FormatError("its match does not fit its dimensions")
        return self.match


KINDS: dict[str, type[Constant | Scratch | Paper]] = {"constant": Constant, "scratch": Scratch, "paper": Paper}
"""Blueprints by their `kind`; the other is `Sandwiched`."""


def plan_of(blueprint: Mapping[str, Any]) -> Constant | Scratch | Paper:
    """Read a blueprint.

    Raises:
        FormatError: not a blueprint of this version.
    """
    return typed(blueprint, KINDS.get(str(blueprint.get("kind")), Sandwiched))


def build(blueprint: Mapping[str, Any]) -> Policy:
    """Build the policy of a blueprint with zero weights; load its state dict next.

    Raises:
        FormatError: not a blueprint of this version.
    """
    return plan_of(blueprint).build()


def build_network(
    core: Mapping[str, Any], generator: torch.Generator | None = None, *, init_std: float = 1.0
) -> PolicyNet | ComposedNet:
    """Build the network of a core with zero weights, or with those of a new one.

    Raises:
        FormatError: neither an architecture nor the blueprint of a policy around a core.
    """
    plan = _network(core)
    if isinstance(plan, Architecture):
        return PolicyNet(plan, generator, init_std=init_std)
    return ComposedNet(plan.build(generator, init_std=init_std))


def nested(core: Mapping[str, Any]) -> int:
    """Count the policies that a core's network is composed of, one around the other."""
    count = 0
    while "kind" in core:
        core, count = core["core"], count + 1
    return count


def _generators(generator: torch.Generator | None) -> dict[str, torch.Generator] | None:
    return None if generator is None else dict.fromkeys(SEEDED, generator)


def _network(core: Mapping[str, Any]) -> Architecture | Paper:
    if "kind" not in core:
        return typed(core, Architecture)
    plan = plan_of(core)
    if not isinstance(plan, Paper):
        raise FormatError("its core is no network, and no policy around a core")
    if nested(core) > MOST_NESTED:
        raise FormatError(f"more than {MOST_NESTED} policies are nested in it")
    return plan
