"""The page of a core, generated from its card: README of the artifact, and what `zoo show` and the docs say."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from transferkit.spec import IOSpec
    from transferkit.zoo.card import Card, Score
    from transferkit.zoo.crossings import Crossings


def render(card: Card, crossings: Crossings | None = None, name: str = "") -> str:
    """Write Markdown; what the core does untrained elsewhere is not in its card and stands there if it is given.

    `name` is what commands call it by, if that is not its id.
    """
    spec, score, name = card.source, card.score, name or card.id
    members = "\n".join(
        f"| {k} | {seed} | {mean:.1f} | {spent['episodes']:.0f} | {spent['steps']:.0f} |"
        for k, (seed, mean, spent) in enumerate(zip(card.seeds, score.members, card.spent, strict=True))
    )
    elements = "\n".join(f"| {i} | {e.name} | {e.quantity} | {e.unit} |" for i, e in enumerate(spec.observation))
    actions = "\n".join(
        f"| {i} | {a.name} | {a.low:g} to {a.high:g} | {a.gear:g} {a.unit} per unit |" for i, a in enumerate(spec.action)
    )
    versions = ", ".join(f"{name} {version}" for name, version in card.versions.items())
    history = "\n".join(f"- {line}" for line in card.history)
    return f"""# {card.id}

{card.description}

Generated from `card.json`. Licence: {card.licence}.{_origin(card)}

**Score on {spec.env_id}:** {score.mean:.1f}, 95 % interval {score.low:.1f} to {score.high:.1f} over {len(card.seeds)} members
and {score.episodes} episodes each (evaluation seed {score.seed}); {_asked(score)}.

| member | seed | mean return | episodes of training | steps of training |
|---|---|---|---|---|
{members}

{_elsewhere(card.id, crossings)}Use:

```sh
transferkit play {name} --out {card.id}.png
transferkit match {name} TARGET
transferkit train --env TARGET --core {name} --steps 20000
```

Robot: {_robot(spec)}.

Observation ({spec.obs_dim}), time step {spec.time_step:g} s, {spec.episode_limit} steps an episode:

| # | element | quantity | unit |
|---|---|---|---|
{elements}

Action ({spec.act_dim}):

| # | actuator | bounds | force |
|---|---|---|---|
{actions}

Made by `{card.command}` with {versions}.

{history}
"""


def _origin(card: Card) -> str:
    return "" if card.origin is None else f" Imported from a file of {card.origin.library}, sha256 {card.origin.sha256}."


def _robot(spec: IOSpec) -> str:
    """Joints, actuators and mass."""
    kinds = {kind: sum(joint.type == kind for joint in spec.joints) for kind in ("slide", "hinge")}
    joints = " and ".join(f"{count} {kind}{'s' * (count > 1)}" for kind, count in kinds.items() if count)
    mass = max((joint.mass for joint in spec.joints), default=0.0)
    weight = f", {mass:.3g} kg" if mass else ""
    return f"{joints or 'no joints that are known'}, {spec.act_dim} actuator{'s' * (spec.act_dim > 1)}{weight}"


def _elsewhere(core: str, crossings: Crossings | None) -> str:
    found = () if crossings is None else crossings.cores.get(core, ())
    if crossings is None or not found:
        return ""
    rows = "\n".join(
        f"| {one.target} | {one.mean:.1f} | {min(one.members):.1f} to {max(one.members):.1f} | {one.zero:.1f} | "
        f"{one.control_mean:.1f} ({one.control}) |"
        for one in sorted(found, key=lambda one: one.target)
        if one.crosses
    )
    others = ", ".join(sorted(one.target for one in found if not one.crosses))
    table = f"\n| environment | mean | members | zero action | best control |\n|---|---|---|---|---|\n{rows}\n" if rows else ""
    rest = f"\nNot with every member above every control: {others}.\n" if others else ""
    return f"""**Untrained on other environments** (study {crossings.study}, {crossings.episodes} episodes a member):
{table}{rest}
"""


def _asked(score: Score) -> str:
    if score.threshold == min(score.members):  # as it is written if none was given
        return "nothing had to be reached"
    return f"every member had to reach {score.threshold:g}"
