"""The README of an artifact, generated from its card."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from transferkit.zoo.card import Card


def render(card: Card) -> str:
    """Write Markdown."""
    spec, score = card.source, card.score
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

Generated from `card.json`. Licence: {card.licence}.

**Score on {spec.env_id}:** {score.mean:.1f}, 95 % interval {score.low:.1f} to {score.high:.1f} over {len(card.seeds)} members
and {score.episodes} episodes each (evaluation seed {score.seed}); every member had to reach {score.threshold:g}.

| member | seed | mean return | episodes of training | steps of training |
|---|---|---|---|---|
{members}

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
