"""`transferkit envs`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING

from transferkit.cli.answer import Answer, parser
from transferkit.cli.environment import add_environment, environment
from transferkit.table import format_table

if TYPE_CHECKING:
    from transferkit.spec import Actuator, Element, IOSpec


def main(arguments: Sequence[str]) -> Answer:
    """List or show environments."""
    flags = parser("envs", "The environments that policies are trained on.")
    actions = flags.add_subparsers(dest="action", required=True)
    actions.add_parser("list", help="every id")
    show = actions.add_parser("show", help="dimensions, element names, units, bounds, time step, limit")
    add_environment(show, "the environment", name="env")
    options = flags.parse_args(arguments)
    from transferkit.envs import derive_spec, environment_ids, find_mirror  # noqa: PLC0415 - seconds to import

    if options.action == "list":
        ids = environment_ids()
        return Answer(ids, "\n".join(ids))
    env = environment(options) or options.env
    spec = derive_spec(env)
    mirror = find_mirror(env, spec)
    image = (
        "its mirror image moves alike: DYNA-DDPG learns from both" if mirror else "no mirror image is known that moves alike"
    )
    data = {**spec.to_json(), "mirror": mirror and asdict(mirror)}
    return Answer(data, f"{describe(spec)}\n\n{image}")


def _reads(element: Element) -> str:
    """The joints that an element responds to, with slopes other than 1 and what it has at zero."""
    slopes = element.coefficients or (1.0,) * len(element.joints)
    terms = [name if slope == 1 else f"{slope:.4g} {name}" for name, slope in zip(element.joints, slopes, strict=True)]
    return ", ".join([*terms, *([f"{element.offset:+.4g}"] if element.offset else [])])


def _besides(actuator: Actuator) -> str:
    """What bounds and gear do not say of an actuator."""
    said = [f"no force at {actuator.rest:g}"] if actuator.rest else []
    said += [f"depends on the joint's {actuator.feedback}"] if actuator.feedback else []
    return "; ".join([*said, *(["from {:g} to {:g} at most".format(*actuator.forces)] if actuator.forces else [])])


def describe(spec: IOSpec) -> str:
    """Describe an environment's numbers and what they mean."""
    limit = "no limit" if spec.episode_limit is None else f"{spec.episode_limit} steps an episode"
    observation = [(i, e.name, e.quantity, e.unit, _reads(e)) for i, e in enumerate(spec.observation)]
    action = [
        (i, a.name, a.model_name, f"{a.low:g} to {a.high:g}", f"{a.gear:g}", a.unit, _besides(a))
        for i, a in enumerate(spec.action)
    ]
    joints = [(j.name, j.model_name, j.type, " ".join(f"{x:g}" for x in j.axis), j.parent or "world") for j in spec.joints]
    return "\n\n".join(
        (
            f"{spec.env_id} ({spec.backend}): {spec.obs_dim} observations, {spec.act_dim} actions, time step "
            f"{spec.time_step:g} s, {limit}",
            format_table(("#", "observation", "quantity", "unit", "joints"), observation),
            format_table(("#", "action", "in the model", "bounds", "gear", "unit", "note"), action),
            format_table(("joint", "in the model", "type", "axis", "parent"), joints) if joints else "no joints known",
        )
    )
