"""`transferkit quickstart`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.cli.answer import Answer, parser, whole
from transferkit.config.checks import NOT_NEGATIVE
from transferkit.table import format_table

if TYPE_CHECKING:
    from transferkit.quickstart import Outcome, ZeroShot
    from transferkit.run import Result

TWIN_TEXT = "{core} on its twin {twin}, untrained ({episodes} episodes a policy): the core's skill is there at once"
TARGET_TEXT = "{core} on {target}, {episodes} episodes of training, seed {seed}: no help is to be expected here"
SOLVED_TEXT = "{target} from scratch with DYNA-DDPG, until an evaluation reaches {solved:g} of 9360, seed {seed}"
NEGATIVE = "No map from two poles to one is known, and the core is not ahead of training from scratch."
PAPER = """The paper's best on two poles is 186, after 200 episodes.
One seed shows how it works; experiments/studies has the claims, over many seeds and with controls."""


def main(arguments: Sequence[str]) -> Answer:
    """Run the main job; answers with its tables."""
    flags = parser(
        "quickstart",
        "Play the inverted-pendulum core on dm_control's cart-pole without training; then train it on "
        "InvertedDoublePendulum-v5 for 200 episodes, beside the same budget from scratch; then solve that with DYNA-DDPG.",
    )
    flags.add_argument("--out", type=Path, default=Path("runs/quickstart"), help="folder of the runs and the pictures")
    flags.add_argument("--seed", type=whole("seed", NOT_NEGATIVE), default=0)
    options = flags.parse_args(arguments)
    from transferkit.cli.progress import progress  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.quickstart import quickstart  # noqa: PLC0415

    outcome = quickstart(options.out, progress, seed=options.seed)
    return Answer(asdict(outcome), _describe(outcome, options.seed))


def _describe(outcome: Outcome, seed: int) -> str:
    core, (twin, episodes), (target, budget) = outcome.core, outcome.twin_task, outcome.target_task
    return "\n\n".join(
        (
            "1. " + TWIN_TEXT.format(core=core, twin=twin, episodes=episodes),
            _untrained_table(outcome),
            "2. " + TARGET_TEXT.format(core=core, target=target, episodes=budget, seed=seed),
            _trained_table(outcome.runs, outcome.zero_action),
            f"{NEGATIVE}\nlearning curves: {outcome.picture}",
            "3. " + SOLVED_TEXT.format(target=target, solved=outcome.threshold, seed=seed),
            _trained_table([outcome.solved], outcome.zero_action),
            f"{PAPER}\nlearning curve: {outcome.solved_picture}",
        )
    )


def _untrained_table(outcome: Outcome) -> str:
    rows = [
        (z.who, f"{z.mean:.0f}", f"{z.low:.0f} to {z.high:.0f}", " ".join(f"{m:.0f}" for m in z.members)) for z in outcome.twin
    ]
    return format_table(("policy", "return", "95 % interval", "each member"), rows)


def _trained_table(runs: Sequence[Result], nothing: ZeroShot) -> str:
    rows = [
        (
            run.core or "scratch",
            run.algo,
            run.episodes,
            run.steps,
            f"{run.seconds:.1f}",
            f"{run.eval_return_mean:.1f}",
            f"{run.eval_return_low:.1f} to {run.eval_return_high:.1f}",
        )
        for run in runs
    ]
    rows.append(("zero action", "", 0, 0, "0.0", f"{nothing.mean:.1f}", f"{nothing.low:.1f} to {nothing.high:.1f}"))
    return format_table(("policy", "trainer", "episodes", "env steps", "seconds", "return", "95 % interval"), rows)
