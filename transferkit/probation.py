"""Probation: before it is trained, a wrapped core plays against doing nothing, and is refused if it is not worth its place.

What a core does on a target can be worse than nothing, and training then starts in a hole. A core that is refused is not
trained: the run is one from scratch, to the bit, but for what this cost. Episodes are played to their end: within a second a
pole that nobody holds does not fall, and a core that holds it only looks busy. More can be asked of it than to be better: who
trains around it explores near what it does, and if that is little, comes to less than from scratch (study `ladder`).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from contextlib import closing
from itertools import chain, islice
from time import monotonic
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from transferkit import stats
from transferkit.envs import episode_limit, rollout, solved_return
from transferkit.evaluation import ZeroPolicy
from transferkit.record.reader import Transitions
from transferkit.run import Probation
from transferkit.streams import Streams

if TYPE_CHECKING:
    from transferkit.budget import Budget
    from transferkit.envs import Transition
    from transferkit.policy.base import Policy

SHARE = 0.1
"""Most of a budget that probation takes."""

ALPHA = 0.1
"""Largest p of a sign-flip test at which a core is trusted. Fewer than four pairs cannot come to it, and must all be better."""

STILL = 1e-6
"""Spread of an action, of a range of [-1, 1], that counts as none."""

Episode = Sequence["Transition"]


def hold_probation(
    policy: Policy, make_env: Callable[[], gymnasium.Env], budget: Budget, pairs: int, seed: int, least_gain: float = 0.0
) -> tuple[Probation, Transitions] | None:
    """Play episodes of the policy's deterministic actions and of zero action in pairs, from the same starts.

    Args:
        policy: a wrapped core.
        make_env: makes the environment.
        budget: of the run.
        pairs: the most; fewer are played if a tenth of the budget holds fewer, but one however few its seconds are.
        seed: of the run; probation has a stream of its own.
        least_gain: share of the way from zero action's return to the environment's `reward_threshold`, if it has one.

    Returns:
        What it came to, and every step that was taken; None if a tenth of the budget holds not one pair.
    """
    started, streams, episodes = monotonic(), Streams(seed), list[Episode]()
    pairs = pairs if budget.episodes is None else min(pairs, int(SHARE * budget.episodes) // 2)
    left = sys.maxsize if budget.steps is None else int(SHARE * budget.steps)
    seconds = math.inf if budget.seconds is None else SHARE * budget.seconds
    with closing(make_env()) as env:
        solved = solved_return(env)
        if not pairs or left < 2 * (episode_limit(env) or 1):
            return None
        for k in range(pairs):
            for actor in (policy, ZeroPolicy(policy.act_dim)):
                steps = rollout(actor, [env], lambda _, k=k: streams.integer("probation", k), episodes=1)
                episodes.append(played := list(islice(steps, left)))
                left -= len(played)
            if not left or monotonic() - started > seconds:
                break
    whole = [episode for episode in episodes if episode and episode[-1].done]
    core, zero = (tuple(sum(step.reward for step in episode) for episode in side) for side in (whole[::2], whole[1::2]))
    seen = _transitions(episodes)
    enough = 0.0 if solved is None or not zero else least_gain * (solved - float(np.mean(zero)))
    accepted, reason = _judge(episodes[::2], core, zero, enough)
    return Probation(accepted, reason, core, zero, len(whole), len(seen), round(monotonic() - started, 3)), seen


def _judge(own: Sequence[Episode], core: Sequence[float], zero: Sequence[float], enough: float) -> tuple[bool, str]:
    """Decide by the returns, which have to differ by so much, and say why."""
    actions = np.stack([step.action for step in chain(*own)]).clip(-1.0, 1.0)
    if np.ptp(actions, axis=0).max() < STILL:
        return False, "its actions never change"
    count = len(zero)
    if not count:
        return True, "not known to be better than doing nothing: no pair of episodes ended within a tenth of the budget"
    p = stats.sign_flip_p(np.subtract(core[:count], zero))
    better = p < ALPHA or p == 0.5**count  # the least that so many pairs can have
    pairs = f"{count} pair{'s' * (count != 1)}"
    means = f"mean return {np.mean(core[:count]):.4g} against {np.mean(zero):.4g} over {pairs} of episodes, p {p:.2g}"
    if not better:
        return False, f"not clearly better than doing nothing: {means}"
    if np.mean(core[:count]) - np.mean(zero) < enough:
        return False, f"better than doing nothing by less than {enough:.4g}: {means}"
    return True, f"better than doing nothing{'' if p < ALPHA else ' in each of few pairs'}: {means}"


def _transitions(episodes: Sequence[Episode]) -> Transitions:
    numbers = ("observation", "action", "reward", "next_observation")
    columns: dict[str, Any] = {
        name: np.array([getattr(step, name) for step in chain(*episodes)], np.float32) for name in numbers
    }
    columns["action"] = columns["action"].clip(-1.0, 1.0)  # what the environment took
    ends: dict[str, Any] = {
        name: np.array([getattr(step, name) for step in chain(*episodes)], bool) for name in ("terminated", "truncated")
    }
    return Transitions(**columns, **ends)
