"""Settings of the sandwich."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

from transferkit.config.checks import NOT_NEGATIVE, POSITIVE, SHARE, WIDTH, Range, check, check_value
from transferkit.errors import ConfigError
from transferkit.pairing import MOST_HELD, Angles, Forces, Limbs

Tap = Literal["features", "action"]
Adapter = Literal["auto", "semantic", "random", "pad"]

HELD, APART = Range(0, MOST_HELD), Range(-3.2, 3.2)
"""Control steps of an action, and radians between limbs."""

FOUND = ("limbs", "angles", "forces", "hold", "stagger")
"""Settings of how a match is found."""


def check_found(names: Iterable[str], config: WrapConfig, match: object = None) -> None:
    """Refuse settings, by their names in `WrapConfig`, of how a match is found where none is looked for.

    Raises:
        ConfigError: one is among them.
    """
    for name in names:
        if name not in FOUND:
            continue
        if match is not None:
            raise ConfigError(f"{{wrap.{name}}} has no effect on a {{match}} that is given", remedy="write it into the match")
        for other, unmatched in (("structure", ("paper",)), ("adapter", ("random", "pad"))):
            if (value := getattr(config, other)) in unmatched:
                raise ConfigError(f"{{wrap.{name}}} has no effect on {{wrap.{other}={value}}}", remedy="leave one of them out")


def check_asked(names: Iterable[str], config: WrapConfig) -> None:
    """Refuse settings, by their names in `WrapConfig`, of a probation that is not held.

    Raises:
        ConfigError: one is among them, and asks for something.
    """
    for name in names:
        if name in ("least_gain", "fall_back") and getattr(config, name) and not config.probation:
            raise ConfigError(
                f"{{wrap.{name}}} has no effect without probation", remedy="give {wrap.probation}, or leave it out"
            )


@dataclass(frozen=True)
class WrapConfig:
    """How a core is built into the policy of another environment."""

    structure: Literal["default", "paper"] = "default"
    """The healthy sandwich, or the paper's with its ReLUs and its shared output layer."""
    tap: Tap = "features"
    """Take the core's last hidden layer, or its action output as the paper does. A core that squashes its actions gives these
    if they are to be scaled or mixed."""
    adapter: Adapter = "auto"
    """Fill the adapters from what the numbers mean, at random, or (a control) element by element with zeros for what is
    missing; auto is semantic if anything matches, else random."""
    limbs: Limbs = "one"
    """Let one limb of the core's robot drive one limb of the target, or all that are like it: each by a copy of the core, which
    share their weights."""
    angles: Angles = "own"
    """Let a hinge read its partner's own angle, or also those of hinges that the core's robot lacks: of a waist between, or of
    all that the partner carries, as far as they swing its centre of mass."""
    forces: Forces = "acceleration"
    """What an action keeps: the acceleration that it causes, or its torque for the robot's weight and length (load); auto keeps
    the load if both robots stand on their limbs, and greater so, but on a lighter robot no less than the acceleration takes."""
    hold: Annotated[int, HELD] = 1
    """Control steps for which an action of the core is held; 0 for as many as last as long as one of its own, if both robots
    stand on their limbs, else 1."""
    stagger: Annotated[float, APART] = 0.0
    """How far apart, in radians, the copies of a core see the first joints of their limbs: limbs in step hardly walk."""
    finetune: bool = True
    """Put square residual layers beside the core, the identity until trained."""
    residual: Annotated[int, Range(0, WIDTH.high)] = 64
    """Width of a side network from the observation straight to the action, zero at the start (Rusu et al. 2016); 0 for none. A
    core sees no more elements than its source had: without a way around it, larger robots are hardly learnt."""
    init_std: Annotated[float, POSITIVE] = 0.6
    """Initial standard deviation of actions that no core action was matched with."""
    least_std: Annotated[float, NOT_NEGATIVE] = 0.0
    """Least initial standard deviation of any action: a core that was trained to its end hardly explores, and what does not
    explore does not learn. 0 keeps the core's own."""
    freeze: Mapping[str, float] = field(default_factory=dict)
    """For each part (`core`, `input_adapter`, ...) the share of the budget during which it does not learn: 1 for all of
    it, 0.5 to unfreeze it half way."""
    lr_scale: Mapping[str, float] = field(default_factory=lambda: {"core": 0.3})
    """Learning rate of a part as a multiple of the trainer's."""
    probation: Annotated[int, Range(0, 1000)] = 0
    """Pairs of episodes in which the core plays against zero action before it is trained; one that is no better is refused, and
    the run is one from scratch. 0 trusts it, and so does a budget that is too small to ask."""
    least_gain: Annotated[float, SHARE] = 0.0
    """How far a core has to come on probation, as a share of the way from zero action's return to the one at which the task
    counts as solved (Gymnasium's `reward_threshold`). 0, or a task that does not say, asks only that it is better."""
    fall_back: bool = False
    """Evaluate and save the core as it was wrapped, while the run's latest training episodes are worse than the core's own
    on probation."""
    critic: bool = False
    """Wrap the core's critics too, if it has as many as the trainer wants and drives one limb; by default they are new, because
    with wrapped ones a larger robot was learnt more slowly (study `residual`)."""
    dynamics: bool = True
    """Wrap the core's model too, if it has one and drives one limb; False starts with a new model."""

    def __post_init__(self) -> None:
        check(self, "wrap")
        if self.hold > 1:
            check_found(["hold"], self)
        for name, allowed in (("freeze", SHARE), ("lr_scale", POSITIVE)):
            for part, value in getattr(self, name).items():
                check_value(f"wrap.{name}.{part}", value, Annotated[float, allowed])


PAPER_WRAP = WrapConfig(structure="paper", tap="action", adapter="random", residual=0, lr_scale={"core": 1 / 3})
"""The paper's sandwich; core at 1e-4 of 3e-4, as on InvertedDoublePendulum; on Hopper the paper uses 1e-5, a thirtieth."""
