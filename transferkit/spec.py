"""What the numbers of an environment mean, as plain data with a JSON round trip.

An `IOSpec` is derived from the physics by `transferkit.envs.probe`; nobody writes one by hand. One that comes from a file is
compared with these annotations, and whatever makes one checks that its parts fit together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

Quantity = Literal[
    "position",
    "velocity",
    "sin",
    "cos",
    "height",
    "function of position",
    "function of velocity",
    "force",
    "action",
    "time",
    "constant",
    "unknown",
]
"""What an observation element can be; `force` responds to controls or contacts, `action` is what was done in a step, `time`
grows by the same in every step; of what is `unknown` nothing can be said."""


MOST = 4096
"""Elements of an observation or an action, and joints."""

DRIVE = "drive."
"""What the name of an actuator begins with, before that of its joint."""

ACTED = ".action"
"""Follows an actuator's name in that of the element which says what it was told."""

EARTH = 9.81
"""Its gravity, m/s^2."""

JointType = Literal["slide", "hinge"]

Feedback = Literal["", "position", "velocity"]


@dataclass(frozen=True)
class Joint:
    """One scalar degree of freedom of the model."""

    name: str
    """Canonical name from type, axis and order along the kinematic tree (`slide_x`, `hinge_y`, `hinge_y2`): the same
    physical system gets the same names in every backend."""
    model_name: str
    """The name in the MuJoCo model."""
    type: JointType
    """Free and ball joints are split into their slides and hinges."""
    axis: tuple[float, float, float]
    """Unit axis in the world frame at the model's reference pose."""
    parent: str | None
    """Canonical name of the next joint towards the world."""
    rest: tuple[float, float, float]
    """Unit vector from the joint to the centre of mass of what it carries, at the reference pose; zero for a slide."""
    length: float
    """Metres from the joint to that centre of mass; 0 for a slide."""
    body: str = ""
    """The body that it moves: joints of one body have one name here; empty if it is not known, as in earlier records."""
    anchor: tuple[float, float, float] | None = None
    """Where the joint is in the world at the reference pose, in metres; None if it is not known."""
    mass: float = 0.0
    """Kilograms of everything that it carries; 0 if it is not known."""
    range: tuple[float, float] | None = None
    """Metres or radians between which it is limited; None if it is not."""
    reference: float = 0.0
    """Its position at the reference pose."""


@dataclass(frozen=True)
class Element:
    """One entry of the observation vector."""

    name: str
    quantity: Quantity
    joints: tuple[str, ...]
    """Canonical names of the joints it responds to."""
    coefficients: tuple[float, ...]
    """`position`, `velocity`: the slope per joint. `sin`, `cos`: the slope of the angle per joint. Otherwise empty."""
    offset: float
    """`position`, `velocity`: value at zero. `cos`: what is added to the angle. Otherwise 0."""
    unit: str
    age: int = 0
    """Control steps since it was true: 0 for what is, 1 for what was one step before."""
    values: tuple[float, ...] = ()
    """Functions of position or velocity: what it says in a few states, the same for robots with the same joints and ranges."""
    doubt: float = 0.0
    """How far, for noise, those may be off."""

    def __post_init__(self) -> None:
        if self.coefficients and len(self.coefficients) != len(self.joints):
            raise ValueError(f"element {self.name} has {len(self.coefficients)} coefficients for {len(self.joints)} joints")

    @property
    def name_now(self) -> str:
        """The name that it has without its age."""
        return self.name.removesuffix(f"[t-{self.age}]")


@dataclass(frozen=True)
class Actuator:
    """One entry of the action vector; actions in [-1, 1] are scaled to [low, high]."""

    name: str
    model_name: str
    joint: str | None
    """Canonical name of the joint it drives; None for tendons, sites and bodies."""
    low: float
    high: float
    gear: float
    """Force or torque on the joint per unit of the environment's action, with its sign, as far as it is not clipped."""
    authority: float
    """Acceleration of the joint, in m/s^2 or rad/s^2, that an action of 1 adds at the reference pose; 0 if unknown."""
    unit: str
    rest: float | None = None
    """The environment's action at which it is told nothing, or exerts no force, or as little as it can; None if that is not
    known, as in earlier records."""
    feedback: Feedback | None = None
    """What its force depends on besides the action: a servo's on the joint's position, or on its velocity alone."""
    stiffness: float = 0.0
    """N/m or N m/rad: how much more a position servo of the model pushes back as its joint moves; 0 of everything else."""
    forces: tuple[float, float] | None = None
    """What it has at its low and its high, where a clip leaves less than `gear` says; None if none does."""

    @property
    def centre(self) -> float:
        """The middle of its bounds, where an action of 0 is."""
        return (self.high + self.low) / 2

    @property
    def half_range(self) -> float:
        """How far an action of 1 is from there."""
        return (self.high - self.low) / 2

    @property
    def still(self) -> float:
        """The action at which it exerts no force, counted from its centre in half ranges."""
        return ((self.rest or 0.0) - self.centre) / self.half_range

    @property
    def left(self) -> tuple[float, float]:
        """The shares that clips leave of the force at its low and at its high."""
        promised = [self.gear * (end - (self.rest or 0.0)) for end in (self.low, self.high)]
        low, high = (force / most if most else 1.0 for force, most in zip(self.forces or promised, promised, strict=True))
        return low, high

    @property
    def acted(self) -> str:
        """The name of the element that says what it was told."""
        return self.name + ACTED


@dataclass(frozen=True)
class IOSpec:
    """The meaning of an environment's observation `(obs_dim,)` and action `(act_dim,)`."""

    env_id: str
    backend: str
    observation: tuple[Element, ...]
    action: tuple[Actuator, ...]
    joints: tuple[Joint, ...]
    time_step: float
    """Control time step in seconds."""
    episode_limit: int | None
    """Control steps until the environment truncates."""
    versions: Mapping[str, str]
    gravity: float = EARTH
    """Acceleration of what falls, m/s^2; specs of before do not say."""
    hold: int = 1
    """Control steps for which a policy of it holds an action: more than one of a run around a core that does."""

    def __post_init__(self) -> None:
        if max(self.obs_dim, self.act_dim, len(self.joints)) > MOST:
            raise ValueError(f"it has {self.obs_dim} observations and {self.act_dim} actions, at most {MOST} are supported")
        if self.time_step and not 1e-6 <= self.time_step <= 1e4:
            raise ValueError(f"its time step is {self.time_step} s")
        if not 0 <= self.gravity <= 1e6:
            raise ValueError(f"its gravity is {self.gravity} m/s^2")
        if not 1 <= self.hold <= 10_000:
            raise ValueError(f"its actions are held for {self.hold} control steps")
        above: set[str | None] = {None}
        for joint in self.joints:
            if joint.parent not in above:
                raise ValueError(f"joint {joint.name} hangs on {joint.parent}, which is no joint before it")
            above.add(joint.name)
        named = {name for element in self.observation for name in element.joints} | {a.joint for a in self.action}
        if strangers := named - above:
            raise ValueError(f"the spec has no joint {min(map(str, strangers))}")

    @property
    def obs_dim(self) -> int:
        """Length of the observation vector."""
        return len(self.observation)

    @property
    def act_dim(self) -> int:
        """Length of the action vector."""
        return len(self.action)

    @property
    def model_names(self) -> dict[str, str]:
        """What the model calls each joint, by canonical name."""
        return {joint.name: joint.model_name for joint in self.joints}

    def has_the_numbers_of(self, other: IOSpec) -> bool:
        """Whether both observe and take the same in the same order, on robots whose joints have the same names."""
        one, two = (
            (
                [(element.name, element.quantity, element.joints) for element in spec.observation],
                [(actuator.name, actuator.model_name) for actuator in spec.action],
                [*spec.model_names.items()],
            )
            for spec in (self, other)
        )
        return one == two

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready data."""
        return asdict(self)
