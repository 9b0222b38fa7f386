"""Derive an `IOSpec` from the physics: move every coordinate and see which observation element answers, and how.

Two kinds of evidence. *Dependence* (`evidence.py`): from random states, one degree of freedom at a time is moved; an element
depends on those that change it. *Form* (`forms.py`): over many random states an element is compared with candidate signals
(each coordinate, the sine and cosine of each angle and of sums of angles, the heights of bodies); one that fits all states
names it.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import gymnasium
import numpy as np

from transferkit.env_id import EnvId
from transferkit.envs.actuators import read_actuators, unknown_actuators
from transferkit.envs.broken import failed
from transferkit.envs.contract import dims, episode_limit, time_step
from transferkit.envs.evidence import Prober
from transferkit.envs.forms import Forms, height_name
from transferkit.envs.frozen import ElusiveError, Frozen
from transferkit.envs.joints import read_joints
from transferkit.envs.labels import labels, unique
from transferkit.envs.make import opened, recorded
from transferkit.envs.memento import learning_wrappers, undisturbed
from transferkit.envs.names import name_of
from transferkit.envs.responses import Responder
from transferkit.envs.simulation import open_simulation
from transferkit.envs.vary import nominal
from transferkit.errors import TransferkitError
from transferkit.spec import EARTH, Element, IOSpec
from transferkit.versions import versions

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from transferkit.envs.contract import Contract
    from transferkit.envs.names import EnvLike
    from transferkit.envs.simulation import Simulation
    from transferkit.spec import Actuator, Joint

LOGGER = logging.getLogger("transferkit")

FEW = 10
"""Steps in which something that is no constant shows itself."""

_DERIVED: dict[str, tuple[object, IOSpec]] = {}
"""What Gymnasium had registered under an id, and the spec that was derived from it."""


def derive_spec(env: EnvLike) -> IOSpec:
    """Derive the meaning of an environment's observation and action.

    Of an environment that is made its state is lost: reset it afterwards. What it observes is probed through all of its
    wrappers, and what it does by what reaches the simulation; what cannot be probed is `unknown`, as everything is outside
    MuJoCo. An id is probed once a process, as long as it names the same.

    Raises:
        UnknownNameError: no environment has this id.
        EnvironmentContractError: it cannot be put under the contract, or fails.
    """
    if not isinstance(env, str):
        return _derive(env)
    registered = gymnasium.registry.get(EnvId.read(env).id)
    if env not in _DERIVED or _DERIVED[env][0] is not registered:
        _DERIVED[env] = registered, _derive(env)
    return _DERIVED[env][1]


def _derive(env: EnvLike) -> IOSpec:
    with opened(env) as made:
        name = name_of(env if isinstance(env, str) else made)
        for wrapper in learning_wrappers(made):
            LOGGER.warning(
                "%s of %s learns outside the policy: its numbers mean something else after every step; leave it out, since "
                "policies normalise what they observe",
                wrapper,
                name,
            )
        try:
            with undisturbed(made):
                env_id = recorded(env if isinstance(env, str) else made)
                with nominal(made):
                    made.reset(seed=0)
                    return _spec(made, env_id)
        except TransferkitError:
            raise
        except Exception as error:
            raise failed(name, "being probed", error) from error


def _spec(made: Contract, env_id: str) -> IOSpec:
    simulation = open_simulation(made)
    pace, by_clock = _pace(made, simulation)
    if not pace:
        LOGGER.warning(
            "how long the steps of %s are is not known: it has no `dt`, and no simulated time was seen to pass", env_id
        )
    if simulation is None:
        backend, joints, actuators = "other", [], unknown_actuators(made.low, made.high)
        elements = _unknown(labels(made.env))
    else:
        backend, joints = simulation.backend, read_joints(simulation.model)
        elements, actuators = _probed(made, simulation, joints, Frozen(made, simulation, pace, by_clock=by_clock))
    return IOSpec(
        env_id=env_id,
        backend=backend,
        observation=tuple(elements),
        action=tuple(actuators),
        joints=tuple(joints),
        time_step=pace,
        episode_limit=episode_limit(made),
        versions={name: versions()[name] for name in ("mujoco", "gymnasium", "dm-control")},
        gravity=EARTH if simulation is None else float(np.linalg.norm(simulation.model.opt.gravity)),
    )


def _probed(
    made: Contract, simulation: Simulation, joints: list[Joint], frozen: Frozen
) -> tuple[list[Element], list[Actuator]]:
    """Elements and actuators; what cannot be probed is unknown, and why is said."""
    (obs_dim, act_dim), names = dims(made), labels(made.env)
    try:
        elusive = _elusive(made)
        made.reset(seed=0)
        with frozen:
            prober = Prober(frozen, simulation, obs_dim, act_dim)
            responses = Responder(frozen, simulation, act_dim, prober.rng).responses()
            if responses.lasting.any():
                LOGGER.warning("what some actions of %s do adds up with those before, and is not known", name_of(made))
            actuators = read_actuators(made.low, made.high, responses, simulation.model, joints)
            forms = Forms(
                dict(enumerate(joints)),
                prober.evidence(),
                prober.samples(),
                partial(height_name, simulation.model),
                [actuator.name for actuator in actuators],
                (made.high - made.low) / 2,
                elusive,
            )
        return _unique([forms.element(i, names[i]) for i in range(obs_dim)]), actuators
    except (ElusiveError, TransferkitError) as error:
        LOGGER.warning("what %s observes is not known: %s", name_of(made), error)
        return _unknown(names), unknown_actuators(made.low, made.high)


def _elusive(made: gymnasium.Env) -> NDArray[np.bool_]:
    """Which elements change in an episode with random actions, or from one episode to the next."""
    made.action_space.seed(0)
    seen = [made.reset(seed=seed)[0] for seed in range(3)]
    for _ in range(FEW):
        observation, _, terminated, truncated, _ = made.step(made.action_space.sample())
        seen.append(observation)
        if terminated or truncated:
            made.reset()
    return np.ptp(np.array(seen, float), axis=0) > 0


def _pace(made: gymnasium.Env, simulation: Simulation | None) -> tuple[float, bool]:
    """Seconds of simulated time of a control step, as declared outside MuJoCo; and whether a step waits for a time to come."""
    declared = time_step(made)
    if simulation is None:
        return declared, False
    passed = _passed(made, simulation)
    simulation.model.opt.timestep /= 2
    slower = _passed(made, simulation)
    simulation.model.opt.timestep *= 2
    by_clock = passed > 0 and slower > 0.75 * passed
    return declared if passed <= 0 or np.isclose(passed, declared) else passed, by_clock


def _passed(made: gymnasium.Env, simulation: Simulation) -> float:
    made.reset(seed=0)
    before = simulation.data.time
    made.step(np.zeros(dims(made)[1], np.float32))
    return round(simulation.data.time - before, 9)


def _unknown(names: list[str]) -> list[Element]:
    return [Element(name, "unknown", (), (), 0.0, "") for name in names]


def _unique(elements: list[Element]) -> list[Element]:
    """Add the age of what is old, and number what occurs twice."""
    names = [f"{element.name}[t-{element.age}]" if element.age else element.name for element in elements]
    return [replace(element, name=name) for element, name in zip(elements, unique(names), strict=True)]
