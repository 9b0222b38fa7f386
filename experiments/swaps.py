"""Put what a target has into a core's own robot, one thing at a time, and play the core untrained: what keeps it from crossing.

`python -m experiments.swaps hopper-v1 dm_control/hopper-stand-v0` takes what a match says that the target can do little of, and
the friction of its floor and feet.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from transferkit import load_core, wrap
from transferkit.cli.answer import Parser
from transferkit.cli.endings import ended
from transferkit.envs import derive_spec, make_env, name_of, open_simulation
from transferkit.errors import ConfigError
from transferkit.evaluation import evaluate
from transferkit.matching import compiled, limits, reach
from transferkit.policy.matches import match
from transferkit.table import format_table

if TYPE_CHECKING:
    import argparse

    import gymnasium

    from transferkit.matching import Limit, Match
    from transferkit.physics import mujoco
    from transferkit.spec import IOSpec

Part = TypeVar("Part")

Swap = Callable[["mujoco.MjModel"], None]
"""A change of the model of the core's own robot."""

ALIKE = 0.05
"""Difference of two frictions, as a share, up to which they count as one."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Play and print; the exit status is 2 if an argument is wrong."""
    parser = Parser(prog="experiments.swaps", description=__doc__)
    parser.add_argument("core", metavar="CORE", help="a core of the zoo")
    parser.add_argument("target", metavar="ENV", help="the environment on which it does not play")
    parser.add_argument("--members", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--episodes", type=int, default=3, help="of each member with each change")
    return ended(lambda: run(parser.parse_args(arguments)), stopped="stopped")


def run(options: argparse.Namespace) -> int:
    """Print the mean return of each member with each change."""
    core, target = load_core(options.core), derive_spec(options.target)
    found = compiled(match(core.spec, target), core.spec, target)
    rows = []
    for name, swap in swaps(found, core.spec, target).items():

        def changed(swap: Swap = swap) -> gymnasium.Env:
            env = make_env(core.spec.env_id)
            swap(_model(env))
            return env

        policies = [wrap(core, core.spec.env_id, member=member) for member in options.members]
        rows.append((name, *(f"{evaluate(policy, changed, episodes=options.episodes).mean:.0f}" for policy in policies)))
        print(" ".join(rows[-1]), file=sys.stderr, flush=True)
    header = f"{core.spec.env_id} with", *(f"member {member}" for member in options.members)
    print(format_table(header, rows))
    return 0


def swaps(found: Match, source: IOSpec, target: IOSpec) -> dict[str, Swap]:
    """Each change by what it is called: nothing, what the target can do little of, its friction, and all of these."""
    one_by_one: dict[str, Swap] = {}
    limited = limits(found, source, target)
    for share, names in _together((one.name, one.share) for one in limited if one.copy == 1):  # both legs
        models = ", ".join(source.model_names[name] for name in names)
        one_by_one[f"{share:.0%} of the range of {models}"] = _ranges(found, source, target, names)
    for share, actions in _together(_forces(found, source, target, limited).items()):
        joints = ", ".join(source.model_names.get(source.action[k].joint or "", source.action[k].name) for k in actions)
        one_by_one[f"{share:.0%} of the force of {joints}"] = _weak(actions, share)
    own, other = (_friction(_model(make_env(spec.env_id))) for spec in (source, target))
    if abs(own - other) > ALIKE * own:
        one_by_one[f"a friction of {other:g} instead of {own:g}"] = _rough(other)

    def everything(model: mujoco.MjModel) -> None:
        for swap in one_by_one.values():
            swap(model)

    return {"nothing": lambda _: None, **one_by_one, "all of these": everything}


def _together(shares: Iterable[tuple[Part, float]]) -> list[tuple[float, list[Part]]]:
    """What has the same share, in the order of its first."""
    found: dict[float, list[Part]] = {}
    for part, share in shares:
        found.setdefault(share, []).append(part)
    return [*found.items()]


def _forces(found: Match, source: IOSpec, target: IOSpec, limited: Sequence[Limit]) -> dict[int, float]:
    """The share of the force of each of the core's actions that is left in the weakest actuator that it drives."""
    rows = {one.name: row for one, row in zip(target.action, found.action_weight, strict=True)}
    least: dict[int, float] = {}
    for one in limited:
        if one.kind == "action":
            driving = [k % source.act_dim for k, weight in enumerate(rows[one.name]) if weight]
            least |= {k: min(one.share, least.get(k, 1.0)) for k in driving}
    return dict(sorted(least.items()))


def _ranges(found: Match, source: IOSpec, target: IOSpec, names: Sequence[str]) -> Swap:
    assert found.pairing is not None
    copy, others = found.pairing.copies[0], {joint.name: joint for joint in target.joints}
    joints = {joint.name: joint for joint in source.joints}

    def swap(model: mujoco.MjModel) -> None:
        for name in names:
            joint, ways = joints[name], reach(copy.joints[name], others, copy.shift.get(name, 0.0))
            model.jnt_range[model.joint(joint.model_name).id] = np.array(ways) + joint.reference

    return swap


def _weak(actions: Sequence[int], share: float) -> Swap:
    def swap(model: mujoco.MjModel) -> None:
        model.actuator_gear[list(actions)] *= share

    return swap


def _rough(friction: float) -> Swap:
    def swap(model: mujoco.MjModel) -> None:
        model.geom_friction[:, 0] = friction

    return swap


def _friction(model: mujoco.MjModel) -> float:
    """The largest sliding friction: of two geoms that touch, the larger one counts."""
    return float(model.geom_friction[:, 0].max())


def _model(env: gymnasium.Env) -> mujoco.MjModel:
    simulation = open_simulation(env)
    if simulation is None:
        raise ConfigError(f"{name_of(env)} has no MuJoCo model", remedy="give an environment of MuJoCo")
    return simulation.model


if __name__ == "__main__":
    sys.exit(main())
