"""What is changed about a robot, as plain data: one value, or a range that is drawn anew in every episode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from transferkit.errors import ConfigError, UnknownNameError

if TYPE_CHECKING:
    import numpy as np

FACTORS = {
    "mass": "body",
    "length": "body",
    "gear": "actuator",
    "damping": "joint",
    "friction": "geom",
    "gravity": "",
}
"""Properties of the model that are multiplied, each with the kind of the parts that have it."""

LEAST = {"mass": 1e-3, "length": 1e-2, "gear": -1e6, "damping": 0.0, "friction": 0.0, "gravity": -1e3}
LARGEST = 1e6
MOST_DELAY = 1000
"""Control steps."""
MOST_FRAMES = 100
STEP_FACTORS = (1e-3, 1e3)
"""By which a control step may be multiplied."""

WHOLE = ("control_step", "delay", "permute_observation", "drop_observation", "frames", "dead_actuator")
"""Of an environment as a whole."""

NAMES = (*FACTORS, *WHOLE, "noise")

Amount = tuple[float, float]
"""The ends of a range; of one value both are it."""

ONE: Amount = (1.0, 1.0)
"""The factor that changes nothing."""

NOTHING: Amount = (0.0, 0.0)

Place = str | int
"""An element by its name or its index."""


@dataclass(frozen=True)
class Variation:
    """Changes of an environment; an empty one changes nothing."""

    factors: Mapping[str, Mapping[str, Amount]] = field(default_factory=dict)
    """By property and part; the part `` stands for all of them."""
    control_step: Amount = ONE
    """Factor of a control step's length; whole physics steps are what is drawn."""
    delay: Amount = (0, 0)
    """Control steps by which actions come late."""
    noise: Mapping[str, Amount] = field(default_factory=dict)
    """Standard deviation of Gaussian noise by element of the observation, in its unit; `` stands for all of them."""
    permute_observation: Sequence[Place] = ()
    """Elements that change places: each stands where the next one stood, and the last where the first did."""
    drop_observation: Sequence[Place] = ()
    """Elements that the observation lacks."""
    frames: int = 1
    """How many of the latest observations are one, the oldest first; at the start of an episode its first one in all places."""
    dead_actuator: Sequence[Place] = ()
    """Actuators without force."""

    @classmethod
    def read(cls, given: Mapping[str, Any]) -> Variation:
        """Take names and JSON values, such as `{"mass": 1.3, "length.thigh": [0.7, 1.3]}`, or tables of them.

        Raises:
            UnknownNameError: nothing of this name can be varied.
            ConfigError: a value that it cannot have.
        """
        tables: dict[str, dict[str, Any]] = {}
        for name, value in given.items():
            what, _, part = name.partition(".")
            if what not in NAMES:
                raise UnknownNameError("variation", what, NAMES, topic="variations")
            values = {str(key): inner for key, inner in value.items()} if isinstance(value, Mapping) else {part: value}
            if not values:
                raise ConfigError(f"variation {what}", value=value, allowed="a value, or a table with one", topic="variations")
            table = tables.setdefault(what, {})
            for part in table.keys() & values.keys():
                named = f"{what}.{part}" if part else what
                raise ConfigError(f"{named} is given twice", remedy="leave one out", topic="variations")
            table.update(values)
        single = {name: tables.pop(name)[""] for name in WHOLE if tables.get(name, {}).keys() == {""}}
        for name in (*WHOLE, "gravity"):
            if tables.get(name, {}).keys() - {""}:
                raise ConfigError(f"{name} is one for the whole environment", remedy=f"give {name}=VALUE", topic="variations")
        return cls(
            {
                name: {part: _amount(name, value, LEAST[name], LARGEST) for part, value in table.items()}
                for name, table in tables.items()
                if name in FACTORS
            },
            _amount("control_step", single.get("control_step", 1.0), *STEP_FACTORS),
            _whole("delay", single.get("delay", 0), 0, MOST_DELAY, "control steps"),
            {part: _amount("noise", value, 0.0, LARGEST) for part, value in tables.get("noise", {}).items()},
            _places("permute_observation", single.get("permute_observation", ())),
            _places("drop_observation", single.get("drop_observation", ())),
            _frames(single.get("frames", 1)),
            _places("dead_actuator", single.get("dead_actuator", ())),
        )

    def with_more(self, changes: Mapping[str, Any]) -> Variation:
        """The same with more changes, as `read` takes them, each in place of one of the same name and part.

        Raises:
            UnknownNameError: nothing of this name can be varied.
            ConfigError: a value that it cannot have.
        """
        more = Variation.read(changes)
        factors = {
            name: {**self.factors.get(name, {}), **more.factors.get(name, {})} for name in {**self.factors, **more.factors}
        }
        given = {name: getattr(more, name) for name in {name.partition(".")[0] for name in changes} & set(WHOLE)}
        return replace(self, factors=factors, noise={**self.noise, **more.noise}, **given)

    def with_actuators(self, names: Mapping[str, str]) -> Variation:
        """The same changes, with actuators called as this table says."""
        tables, gears = dict(self.factors), dict[str, Amount]()
        for part, amount in tables.get("gear", {}).items():
            if (name := names.get(part, part)) in gears:
                raise ConfigError(f"gear has {name} under two names", remedy="leave one out", topic="variations")
            gears[name] = amount
        tables |= {"gear": gears} if gears else {}
        return replace(self, factors=tables, dead_actuator=[names.get(str(place), place) for place in self.dead_actuator])

    @property
    def drawn(self) -> bool:
        """Whether the model differs from one episode to the next."""
        return any(low < high for table in self.factors.values() for low, high in table.values())

    def written(self) -> dict[str, Any]:
        """Names and JSON values that `read` takes."""
        tables = {**self.factors, "noise": self.noise}
        flat = {
            f"{name}.{part}" if part else name: _plain(amount)
            for name, table in tables.items()
            if table != {"": NOTHING if name == "noise" else ONE}
            for part, amount in table.items()
        }
        lists = {name: list(getattr(self, name)) for name in ("permute_observation", "drop_observation", "dead_actuator")}
        whole = {
            "control_step": 0 if self.control_step == ONE else _plain(self.control_step),
            "delay": _plain((int(self.delay[0]), int(self.delay[1]))),
            "frames": self.frames if self.frames > 1 else 0,
        }
        return flat | {name: value for name, value in (whole | lists).items() if value}

    def draw(self, rng: np.random.Generator) -> dict[str, dict[str, float]]:
        """Factors of an episode, by property and part."""
        return {name: {part: draw(amount, rng) for part, amount in table.items()} for name, table in self.factors.items()}

    def nominal(self) -> dict[str, dict[str, float]]:
        """Factors of the robot that a family is drawn around: 1, or the middle of a range that does not hold it."""
        return {name: {part: _nominal(amount) for part, amount in table.items()} for name, table in self.factors.items()}


def _nominal(amount: Amount) -> float:
    low, high = amount
    return 1.0 if low <= 1.0 <= high and low < high else (low + high) / 2


def draw(amount: Amount, rng: np.random.Generator) -> float:
    """A value of a range."""
    low, high = amount
    return float(rng.uniform(low, high)) if low < high else low


def _plain(amount: Amount) -> float | list[float]:
    return amount[0] if amount[0] == amount[1] else list(amount)


def _amount(name: str, value: Any, least: float, most: float) -> Amount:  # noqa: ANN401 - JSON
    value = _plain_value(value)
    ends = list(value) if isinstance(value, list | tuple) else [value, value]
    fits = len(ends) == 2 and all(_is_number(end) and least <= end <= most for end in ends) and ends[0] <= ends[1]
    if not fits:
        raise ConfigError(
            f"variation {name}",
            value=value,
            allowed=f"a number or a range, low first, {least:g} to {most:g}",
            topic="variations",
        )
    return float(ends[0]), float(ends[1])


def _whole(name: str, value: Any, least: float, most: float, of: str) -> Amount:  # noqa: ANN401 - JSON
    amount = _amount(name, value, least, most)
    if any(end != int(end) for end in amount):
        raise ConfigError(f"variation {name}", value=value, allowed=f"whole {of}", topic="variations")
    return amount


def _frames(value: Any) -> int:  # noqa: ANN401 - JSON
    low, high = _whole("frames", value, 1, MOST_FRAMES, "numbers")
    if low < high:
        raise ConfigError("variation frames", value=value, allowed="one number and no range", topic="variations")
    return int(low)


def _places(name: str, value: Any) -> tuple[Place, ...]:  # noqa: ANN401 - JSON
    value = _plain_value(value)
    places = value.split(",") if isinstance(value, str) else list(value) if isinstance(value, list | tuple) else [value]
    places = [int(place) if isinstance(place, str) and place.isdecimal() else place for place in places]
    if not all(isinstance(place, str | int) and not isinstance(place, bool) for place in places):
        raise ConfigError(f"variation {name}", value=value, allowed="names or indices", topic="variations")
    return tuple(places)


def _plain_value(value: Any) -> Any:  # noqa: ANN401
    """A number or a list of what numpy has."""
    if isinstance(value, list | tuple):
        return [_plain_value(inner) for inner in value]
    return value.tolist() if hasattr(value, "tolist") else value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
