"""Mirror images of a robot: if its image moves as it does, every step teaches what its image would have taught.

A reflection of the world, or an exchange of limbs that are alike, maps joints onto joints. Candidates follow from the spec; one
holds if in the simulation the image of a state and of an action leads to the image of what follows, with the same reward.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from transferkit.envs.make import opened
from transferkit.envs.memento import undisturbed
from transferkit.envs.probe import derive_spec
from transferkit.envs.simulation import open_simulation
from transferkit.errors import TransferkitError
from transferkit.physics import mujoco

if TYPE_CHECKING:
    from transferkit.envs.contract import Contract
    from transferkit.envs.names import EnvLike
    from transferkit.envs.simulation import Simulation
    from transferkit.spec import IOSpec, Joint

LOGGER = logging.getLogger("transferkit")

REFLECTIONS = ((1.0, 1.0, 1.0), (-1.0, 1.0, 1.0), (1.0, -1.0, 1.0))
"""None, of x, and of y: gravity keeps z."""

CASES, TOLERANCE = 24, 1e-3
"""States that are tried, and the largest difference from the image, as a share of the largest number."""

ROUNDING = 1e-6
"""A difference up to this is rounding."""

MOST = 8
"""Maps of joints that are tried."""


@dataclass(frozen=True)
class Signed:
    """A permutation with signs: element k of the image is `sign[k]` times element `index[k]`."""

    index: tuple[int, ...]
    sign: tuple[float, ...]

    def __call__(self, values: NDArray) -> NDArray:
        """The image of values `(..., n)`."""
        return values[..., list(self.index)] * np.array(self.sign)


@dataclass(frozen=True)
class Mirror:
    """How an observation `(obs_dim,)` and an action `(act_dim,)` look in the mirror; twice is as it was."""

    observation: Signed
    action: Signed


def find_mirror(env: EnvLike, spec: IOSpec | None = None) -> Mirror | None:
    """Find the mirror image of an environment; None if it has none, or free joints, or is not MuJoCo.

    Of an environment that is made its state is lost. One that fails in states where it is tried is said to have none.

    Args:
        env: in any form that `make_env` takes.
        spec: its own, if that is known.

    Raises:
        UnknownNameError: no environment has this id.
        EnvironmentContractError: it cannot be put under the contract, or fails as it is probed.
    """
    spec = derive_spec(env) if spec is None else spec
    maps = list(itertools.islice(_joint_maps(spec), MOST)) if spec.joints else []
    if not maps:
        return None
    with opened(env) as made, undisturbed(made):
        simulation = open_simulation(made)
        if simulation is None or simulation.model.nq != len(spec.joints):
            return None
        steps = 1 + max(element.age for element in spec.observation)
        pairs = [(joints, action) for joints in maps if (action := _actions(spec, joints)) is not None]
        try:
            found = (_held(made, simulation, *pair, steps) for pair in pairs)
            return next((mirror for mirror in found if mirror is not None), None)
        except TransferkitError as error:
            LOGGER.warning("whether %s has a mirror image is not known: %s", spec.env_id, error)
            return None


def _joint_maps(spec: IOSpec) -> Iterator[Signed]:
    """Maps of a robot's joints onto joints that are alike and hang alike, in some mirror."""
    for reflection in REFLECTIONS:
        mirror = np.array(reflection)
        for index in _embeddings(spec.joints, mirror, ()):
            signs = tuple(_sign(spec.joints[k], spec.joints[i], mirror) for i, k in enumerate(index))
            if any(i != k for i, k in enumerate(index)) or min(signs) < 0:
                yield Signed(index, signs)


def _embeddings(joints: tuple[Joint, ...], mirror: NDArray, begun: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Ways to choose what each joint is the image of, from the root on."""
    if len(begun) == len(joints):
        yield begun
        return
    image, names = joints[len(begun)], [joint.name for joint in joints]
    upper = None if image.parent is None else joints[begun[names.index(image.parent)]].name
    for k, joint in enumerate(joints):
        if k not in begun and joint.parent == upper and _alike(joint, image, mirror):
            yield from _embeddings(joints, mirror, (*begun, k))


def _alike(joint: Joint, image: Joint, mirror: NDArray) -> bool:
    sign = _sign(joint, image, mirror)
    if joint.type != image.type or not sign or (joint.range is None) != (image.range is None):
        return False
    own, others = [*joint.rest * mirror, joint.length, joint.mass], [*image.rest, image.length, image.mass]
    if joint.anchor is not None and image.anchor is not None:
        own, others = [*own, *joint.anchor * mirror], [*others, *image.anchor]
    if joint.range is not None and image.range is not None:
        own += sorted(sign * (limit - joint.reference) for limit in joint.range)
        others += [limit - image.reference for limit in image.range]
    return np.allclose(own, others, rtol=TOLERANCE, atol=TOLERANCE)


def _sign(joint: Joint, image: Joint, mirror: NDArray) -> float:
    """Whether a joint's image turns as another joint does, 1, the other way, -1, or about another axis, 0.

    A reflection turns round what turns about an axis that it keeps.
    """
    turned = np.prod(mirror) if joint.type == "hinge" else 1.0
    along = turned * float(np.dot(mirror * joint.axis, image.axis))
    return float(np.sign(along)) if abs(along) > 1 - TOLERANCE else 0.0


def _actions(spec: IOSpec, joints: Signed) -> Signed | None:
    """The map of actions that goes with one of joints: what drives a joint drives its image alike."""
    names, index, signs = [joint.name for joint in spec.joints], [], []
    for actuator in spec.action:
        if actuator.joint is None:
            return None
        i = names.index(actuator.joint)
        own = [k for k, other in enumerate(spec.action) if other.joint == names[joints.index[i]]]
        beside = [other.name for other in spec.action if other.joint == actuator.joint]
        if len(own) != len(beside):
            return None
        k = own[beside.index(actuator.name)]
        sign = joints.sign[i] * float(np.sign(actuator.gear * spec.action[k].gear))
        bounds = sorted((sign * spec.action[k].low, sign * spec.action[k].high))
        if not sign or not np.allclose(bounds, [actuator.low, actuator.high]):
            return None
        index.append(k)
        signs.append(sign)
    return Signed(tuple(index), tuple(signs))


def _held(made: Contract, simulation: Simulation, joints: Signed, action: Signed, steps: int) -> Mirror | None:
    """The mirror of these maps, if what follows the image of a state is the image of what follows it.

    So many `steps` are taken that nothing observed is from before.
    """
    rng, ones, others = np.random.default_rng(0), [], []
    reference = simulation.model.qpos0
    for case in range(CASES):
        made.reset(seed=case)
        qpos, qvel = _random_state(simulation, rng)
        told = rng.uniform(-1.0, 1.0, (steps, len(action.index))).astype(np.float32)
        ones.append(_play(made, simulation, qpos, qvel, told))
        made.reset(seed=case)
        image = reference + joints(qpos - reference), joints(qvel), action(told).astype(np.float32)
        others.append(_play(made, simulation, *image))
    (seen, *outcome), (images, *theirs) = ([np.array(part) for part in zip(*played, strict=True)] for played in (ones, others))
    if not all(np.abs(one - other).max() <= _least(one) for one, other in zip(outcome, theirs, strict=True)):
        return None
    observation = _observation_map(seen, images)
    return None if observation is None else Mirror(observation, action)


def _random_state(simulation: Simulation, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Near where an episode began, far from there, or slow and at limits, where forces show."""
    model, qpos, kind = simulation.model, simulation.data.qpos, rng.integers(3)
    low, high = np.where(model.jnt_limited.astype(bool), model.jnt_range.T, [[-2.0], [2.0]])
    reach = np.minimum(high - low, 4.0) * (0.05, 0.5, 1.0)[kind]
    qpos = qpos + reach * rng.uniform(-1.0, 1.0, model.nv)
    return np.clip(qpos, low, high) if kind == 2 else qpos, (1.0, 5.0, 0.01)[kind] * rng.uniform(-1.0, 1.0, model.nv)


def _play(
    made: Contract, simulation: Simulation, qpos: NDArray, qvel: NDArray, actions: NDArray[np.float32]
) -> tuple[NDArray, list[float], list[float]]:
    """The last observation, the rewards and the ends, as numbers, of some steps from a state."""
    data = simulation.data
    data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = qpos, qvel, 0.0
    mujoco.mj_forward(simulation.model, data)
    steps = [made.step(action) for action in actions]
    return steps[-1][0].astype(np.float64), [step[1] for step in steps], [float(step[2]) for step in steps]


def _least(values: NDArray) -> float:
    """The least difference that tells from these values."""
    return TOLERANCE * float(np.abs(values).max()) + ROUNDING


def _observation_map(seen: NDArray, images: NDArray) -> Signed | None:
    """Which element `(cases,)` of what was seen each element of the images is, with which sign; None if one is of none."""
    index, signs = [], []
    for i in range(images.shape[1]):
        order = sorted(range(images.shape[1]), key=lambda k, i=i: k != i)
        pairs = ((k, sign) for k in order for sign in (1.0, -1.0))
        fits = [(k, sign) for k, sign in pairs if (np.abs(images[:, i] - sign * seen[:, k]) <= _least(seen[:, k])).all()]
        if not fits:
            return None
        index.append(fits[0][0])
        signs.append(fits[0][1])
    twice = all(index[index[i]] == i and signs[i] == signs[index[i]] for i in range(len(index)))
    return Signed(tuple(index), tuple(signs)) if twice else None
