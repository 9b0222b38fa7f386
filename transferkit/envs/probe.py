"""Derive an `IOSpec` from the physics: move every coordinate and see which observation element answers, and how.

Two kinds of evidence. *Dependence* (`evidence.py`): from random states, one degree of freedom at a time is moved; an element
depends on those that change it. *Form* (`forms.py`): over many random states an element is compared with candidate signals
(each coordinate, the sine and cosine of each angle and of sums of angles, the heights of bodies); one that fits all states
names it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import gymnasium

from transferkit.envs.evidence import Prober
from transferkit.envs.forms import Forms, height_name
from transferkit.envs.joints import read_actuators, read_joints, unknown_actuators
from transferkit.envs.make import dims, episode_limit, failed, make_env, name_of, time_step
from transferkit.envs.simulation import open_simulation
from transferkit.errors import TransferkitError
from transferkit.spec import Element, IOSpec
from transferkit.versions import versions

if TYPE_CHECKING:
    from transferkit.envs.simulation import Simulation
    from transferkit.spec import Joint

_DERIVED: dict[str, tuple[object, IOSpec]] = {}
"""What Gymnasium had registered under an id, and the spec that was derived from it."""


def derive_spec(env: str | gymnasium.Env) -> IOSpec:
    """Derive the meaning of an environment's observation and action; its state is lost (reset it afterwards).

    Works for every MuJoCo environment of either backend. If the backend does not let the observation be asked for, and
    outside MuJoCo, every element is `unknown`. An id is probed once a process, as long as it names the same.
    """
    if not isinstance(env, str):
        return _derive(env)
    registered = gymnasium.registry.get(env)
    if env not in _DERIVED or _DERIVED[env][0] is not registered:
        _DERIVED[env] = registered, _derive(env)
    return _DERIVED[env][1]


def _derive(env: str | gymnasium.Env) -> IOSpec:
    made = make_env(env)
    name = name_of(env)
    try:
        made.reset(seed=0)
        return _spec(made, name)
    except TransferkitError:
        raise
    except Exception as error:
        raise failed(name, "being probed", error) from error
    finally:
        if isinstance(env, str):
            made.close()


def _spec(made: gymnasium.Env, env_id: str) -> IOSpec:
    raw: Any = made
    raw = raw.env  # below the scaling of actions
    low, high, obs_dim = raw.action_space.low, raw.action_space.high, dims(made)[0]
    simulation = open_simulation(raw)
    if simulation is None:
        backend, joints, actuators = "other", [], unknown_actuators(low, high)
        elements = _unknown([f"observation[{i}]" for i in range(obs_dim)])
    else:
        backend, joints = simulation.backend, read_joints(simulation.model)
        actuators = read_actuators(low, high, simulation.model, joints)
        elements = _elements(simulation, joints, obs_dim)
    return IOSpec(
        env_id=env_id,
        backend=backend,
        observation=tuple(elements),
        action=tuple(actuators),
        joints=tuple(joints),
        time_step=time_step(made),
        episode_limit=episode_limit(made),
        versions={name: versions()[name] for name in ("mujoco", "gymnasium", "dm-control")},
    )


def _elements(simulation: Simulation, joints: list[Joint], obs_dim: int) -> list[Element]:
    if simulation.observe is None:
        return _unknown(simulation.labels)
    prober = Prober(simulation.model, simulation.data, simulation.observe, obs_dim)
    forms = Forms(dict(enumerate(joints)), prober.evidence(), prober.samples(), partial(height_name, simulation.model))
    return _unique([forms.element(i, simulation.labels[i]) for i in range(obs_dim)])


def _unknown(labels: list[str]) -> list[Element]:
    return [Element(label, "unknown", (), (), 0.0, "") for label in labels]


def _unique(elements: list[Element]) -> list[Element]:
    seen: Counter[str] = Counter()
    result = []
    for element in elements:
        seen[element.name] += 1
        copies = seen[element.name]
        result.append(element if copies == 1 else replace(element, name=f"{element.name}#{copies}"))
    return result
