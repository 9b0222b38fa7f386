"""The same robot changed: `vary`, and the wrapper that it makes."""

from __future__ import annotations

import copy
import functools
import math
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from transferkit.envs.layers import bounds, check_spaces, layers_of
from transferkit.envs.model_edits import compiled, edited
from transferkit.envs.names import name_of
from transferkit.envs.simulation import open_simulation
from transferkit.errors import ConfigError, EnvironmentContractError, TransferkitError, UnknownNameError
from transferkit.physics import mujoco
from transferkit.spec import DRIVE
from transferkit.variation import ONE, Variation, draw

if TYPE_CHECKING:
    from transferkit.spec import IOSpec

ROUNDING = 1e-6
"""Of a physics step."""

LOADERS = ("from_xml_path", "from_xml_string")
"""Methods of `MjModel` that read a model."""


class Varied(gymnasium.Wrapper, RecordConstructorArgs):
    """A robot whose model, observation or actions are changed; what is a range is drawn anew in every episode.

    The draws of an episode follow from the seed of its reset alone.
    """

    def __init__(self, env: gymnasium.Env, variation: dict[str, Any], again: Callable[[], gymnasium.Env] | None = None) -> None:
        """Take the environment, what `Variation.read` takes, and what makes the environment again; by default its `spec`.

        Raises:
            UnknownNameError: the model or the observation has no such part.
            ConfigError: the change cannot be made on this environment.
            EnvironmentContractError: its observations or actions are not flat.
        """
        RecordConstructorArgs.__init__(self, variation=variation)
        super().__init__(env)
        self._again = again
        self.variation = Variation.read(variation)
        self.nominal = False
        """Whether what is a range stays in its middle, while the robot is looked at."""
        changes_model = bool(self.variation.factors or self.variation.dead_actuator)
        self._model = _Model(env, again) if changes_model else None
        self._pace = _Pace(env, self.variation.control_step) if self.variation.control_step != ONE else None
        check_spaces(env, name_of(env))
        spec = _spec(env) if self._by_name else None
        self._names = [] if spec is None else [element.name for element in spec.observation]
        drives = {} if spec is None else {actuator.name: actuator.model_name for actuator in spec.action}
        self._of_model = self.variation.with_actuators(drives)
        size = _size(env)
        moved, dropped = (
            [self._index(place, name) for place in getattr(self.variation, name)]
            for name in ("permute_observation", "drop_observation")
        )
        if len(set(moved)) < len(moved):
            raise ConfigError("permute_observation", value=moved, allowed="each element once", topic="variations")
        order = np.arange(size)
        order[np.roll(moved, -1).astype(int)] = moved
        self._kept = order[~np.isin(order, dropped)]
        noise = sorted(self.variation.noise.items(), key=lambda one: one[0] != "")  # for all, then by name
        self._noisy = [(self._index(name, "noise") if name else slice(None), amount) for name, amount in noise]
        if not len(self._kept):
            raise ConfigError("nothing is left to observe", remedy="drop fewer elements", topic="variations")
        self.observation_space = Box(-np.inf, np.inf, (len(self._kept) * self.variation.frames,), np.float64)
        self._frames: deque[NDArray[np.float64]] = deque(maxlen=self.variation.frames)
        actions = bounds(env)
        assert isinstance(actions, Box)  # which was checked
        self._idle = np.clip(np.zeros(actions.shape), actions.low, actions.high)
        self._begin(None)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """Draw what is a range, and start an episode."""
        self._begin(seed)
        observation, info = self.env.reset(seed=seed, options=options)
        if self._model is not None and self._model.gone:
            raise ConfigError(f"{self.env} makes its model anew in every episode, so it cannot be varied", topic="variations")
        first = self._measured(observation)
        self._frames.extend([first] * self.variation.frames)
        return self._observed(), info

    def step(self, action: NDArray[np.floating]) -> tuple[NDArray[np.float64], Any, bool, bool, dict[str, Any]]:
        """Take the action that is due, and observe with noise."""
        self._late.append(np.asarray(action, np.float64))
        observation, reward, terminated, truncated, info = self.env.step(self._late.popleft())
        self._frames.append(self._measured(observation))
        return self._observed(), reward, terminated, truncated, info

    def with_more(self, variation: dict[str, Any]) -> Varied:
        """The same environment with more changes, in place of those of the same name."""
        changed = self.variation.with_more(variation).written()
        for part in (self._model, self._pace):
            if part is not None:
                part.restore()
        return Varied(self.env, changed, self._again)

    @property
    def _by_name(self) -> bool:
        changed = self.variation
        places = (*changed.permute_observation, *changed.drop_observation, *changed.dead_actuator)
        gears = (part.startswith(DRIVE) for part in changed.factors.get("gear", ()))
        return any(changed.noise) or any(isinstance(place, str) for place in places) or any(gears)

    def _begin(self, seed: int | None) -> None:
        if seed is not None or not hasattr(self, "_rng"):
            self._rng = np.random.default_rng([zlib.crc32(b"variation"), seed or 0])
        if self._model is not None and (self.variation.drawn or not self._model.changed):
            changed = self._of_model
            self._model.change(changed.nominal() if self.nominal else changed.draw(self._rng), changed.dead_actuator)
        low, high = (int(end) for end in self.variation.delay)
        self._late = deque([self._idle] * int(self._rng.integers(low, high + 1)))
        self._deviation = np.zeros(_size(self.env))
        for where, amount in self._noisy:
            self._deviation[where] = draw(amount, self._rng)
        if self._pace is not None:
            self._pace.change(None if self.nominal else self._rng)

    def _observed(self) -> NDArray[np.float64]:
        return np.concatenate(self._frames)

    def _measured(self, raw: NDArray[np.floating]) -> NDArray[np.float64]:
        observation, declared = np.asarray(raw, np.float64), self.env.observation_space.shape
        if observation.shape != declared:
            raise EnvironmentContractError(
                f"environment {name_of(self.env)} returned an observation of shape {observation.shape}, not {declared}",
                topic="own environments",
            )
        if self._deviation.any():
            observation = observation + self._rng.normal(size=observation.shape) * self._deviation
        return observation[self._kept]

    def _index(self, place: str | int, change: str) -> int:
        if isinstance(place, str):
            if place not in self._names:
                raise UnknownNameError("element of the observation", place, self._names, topic="variations")
            return self._names.index(place)
        if not 0 <= place < _size(self.env):
            raise ConfigError(change, value=place, allowed=f"0 to {_size(self.env) - 1}", topic="variations")
        return place


class _Model:
    """The model of an environment, whose numbers are replaced in place."""

    def __init__(self, env: gymnasium.Env, again: Callable[[], gymnasium.Env] | None) -> None:
        simulation = open_simulation(env)
        if simulation is None:
            raise ConfigError(f"{env} is not a MuJoCo environment, whose model could be varied", topic="variations")
        self._simulation, self._live = simulation, simulation.model
        self._spec = _source(env, again)
        self._base = compiled(self._spec.copy())
        self.changed: dict[str, NDArray[np.bool_]] = {}
        self._has_other_inertia = False

    def __deepcopy__(self, memo: dict[int, Any]) -> _Model:
        """Share what is never changed."""
        twin = object.__new__(_Model)
        memo[id(self)] = twin
        twin._spec, twin._base, twin.changed = self._spec, self._base, dict(self.changed)
        twin._has_other_inertia = self._has_other_inertia
        twin._simulation = copy.deepcopy(self._simulation, memo)
        twin._live = twin._simulation.model
        return twin

    @property
    def gone(self) -> bool:
        """Whether the environment has another model by now."""
        return self._simulation.model is not self._live

    def restore(self) -> None:
        """Give the environment's model its own numbers back."""
        self._take(self._base)
        self.changed, self._has_other_inertia = {}, False

    def change(self, factors: dict[str, dict[str, float]], dead: Any) -> None:  # noqa: ANN401
        """Give the environment's model the numbers of a changed one."""
        model = edited(self._spec, factors, dead)
        self.restore()
        changed = _differences(self._base, model)
        for name, different in changed.items():
            live, base = (attrgetter(name)(one) for one in (self._live, self._base))
            if not np.array_equal(live[different], base[different]):
                raise ConfigError(
                    f"{name} of the model is changed after it is loaded, so it cannot be varied",
                    remedy="if `vary` changed it, vary what that returned, or give an id or a function",
                    topic="variations",
                )
        self.changed = changed
        self._has_other_inertia = model.stat.meaninertia != self._base.stat.meaninertia
        self._take(model)

    def _take(self, model: mujoco.MjModel) -> None:
        """Take the numbers of a model where they are changed."""
        for name, changed in self.changed.items():
            attrgetter(name)(self._live)[changed] = attrgetter(name)(model)[changed]
        if self._has_other_inertia:
            self._live.stat.meaninertia = model.stat.meaninertia


class _Pace:
    """How many physics steps a control step has: one of a few numbers."""

    def __init__(self, env: gymnasium.Env, factor: tuple[float, float]) -> None:
        simulation = open_simulation(env)
        counters = [] if simulation is None else simulation.counters
        if len(counters) != 1:
            raise ConfigError(
                f"control_step of {env} cannot be varied: it holds no number of physics steps (`frame_skip`)",
                topic="variations",
            )
        self._keeper, self._name = counters[0]
        self._own = getattr(self._keeper, self._name)
        self._least, self._most = math.ceil(factor[0] * self._own - ROUNDING), math.floor(factor[1] * self._own + ROUNDING)
        if not 1 <= self._least <= self._most:
            raise ConfigError(
                "variation control_step",
                value=factor[0] if factor[0] == factor[1] else list(factor),
                allowed=f"a multiple of {1 / self._own:g}, or a range with one (physics steps of a control step: {self._own})",
                topic="variations",
            )

    def change(self, rng: np.random.Generator | None) -> None:
        """Draw a number; without a generator the own one, or the middle if it is not among them."""
        least, most = self._least, self._most
        own = self._own if least <= self._own <= most else (least + most) // 2
        self._hold(own if rng is None else int(rng.integers(least, most + 1)))

    def restore(self) -> None:
        """Give the environment its own number back."""
        self._hold(self._own)

    def _hold(self, steps: int) -> None:
        setattr(self._keeper, self._name, steps)


@contextmanager
def nominal(env: gymnasium.Env) -> Iterator[None]:
    """Show the robot that a family is drawn around, from the next reset on."""
    layers = [layer for layer in layers_of(env) if isinstance(layer, Varied)]
    for layer in layers:
        layer.nominal = True
    try:
        yield
    finally:
        for layer in layers:
            layer.nominal = False


def _differences(base: mujoco.MjModel, new: mujoco.MjModel) -> dict[str, NDArray[np.bool_]]:
    """Where the arrays of two models differ, by name."""
    found = {}
    for name in _array_names():
        before, after = (attrgetter(name)(model) for model in (base, new))
        if before.shape != after.shape:
            raise ConfigError(f"{name} of the varied model has another shape", topic="variations")
        if not np.array_equal(before, after, equal_nan=before.dtype.kind == "f"):
            found[name] = before != after
    return found


@functools.cache
def _array_names() -> list[str]:
    """The arrays of a model, but for pictures."""
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    names = [name for name in dir(model) if not name.startswith(("_", "tex_"))]
    return ["opt.gravity", *(name for name in names if isinstance(getattr(model, name), np.ndarray))]


def _source(env: gymnasium.Env, again: Callable[[], gymnasium.Env] | None) -> mujoco.MjSpec:
    """What the model of an environment is compiled from: the environment is made again, and what it reads is read."""
    spec = env.unwrapped.spec  # wrappers change no model
    if again is None and spec is None:
        raise ConfigError(f"{env} has no id to make it again", remedy="give a function that makes it", topic="variations")
    with _loading() as sources:
        try:
            made = again() if again is not None or spec is None else gymnasium.make(spec)  # pyright: ignore[reportOptionalCall]
            made.close()
        except TransferkitError:
            raise
        except Exception as error:  # of somebody else's environment
            raise ConfigError(f"{env} cannot be made again: {type(error).__name__}: {error}", topic="variations") from error
    if not sources:
        raise ConfigError(f"the model of {env} is not read from XML, so it cannot be varied", topic="variations")
    return sources[-1]()


@contextmanager
def _loading() -> Iterator[list[Callable[[], mujoco.MjSpec]]]:
    """Note from what models are loaded meanwhile."""
    kept = {name: getattr(mujoco.MjModel, name) for name in LOADERS}
    sources: list[Callable[[], mujoco.MjSpec]] = []

    def noting(name: str) -> Callable[..., mujoco.MjModel]:
        def load(*arguments: Any, **named: Any) -> mujoco.MjModel:  # noqa: ANN401 - passed on
            sources.append(lambda: _read(name, *arguments, **named))
            return kept[name](*arguments, **named)

        return load

    for name in LOADERS:
        setattr(mujoco.MjModel, name, noting(name))
    try:
        yield sources
    finally:
        for name, loader in kept.items():
            setattr(mujoco.MjModel, name, loader)


def _read(loader: str, source: str | bytes = "", assets: dict[str, bytes] | None = None, **named: Any) -> mujoco.MjSpec:  # noqa: ANN401
    source = named.get("filename", named.get("xml", source))
    text = source.decode() if isinstance(source, bytes) else source
    files = dict(assets or {})
    if loader == "from_xml_path":
        return mujoco.MjSpec.from_file(text, assets=files)
    return mujoco.MjSpec.from_string(text, include={k: v for k, v in files.items() if k.endswith(".xml")}, assets=files)


def _spec(env: gymnasium.Env) -> IOSpec:
    from transferkit.envs.probe import derive_spec  # noqa: PLC0415 - which makes environments

    return derive_spec(env)


def _size(env: gymnasium.Env) -> int:
    assert env.observation_space.shape is not None
    return env.observation_space.shape[0]
