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
ROBOT_TEXT = "{core} on {robot}, its one leg driving two: {steps:,} steps or {episodes} episodes of PPO, seed {seed}"
ROBOT_STUDY = "Over ten seeds, three members and with controls: experiments/studies/ladder, rung 7."
POLES_TEXT = "{core} on {poles}, on which a core does next to nothing: {refused} (experiments/studies/first_matrix_gymnasium)"
ALONE_TEXT = "So it is learnt from scratch, with DYNA-DDPG ({steps:,} steps or {episodes} episodes, seed {seed}):"
ALONE_STUDY = "The paper's best has 186 after 200 episodes; twenty seeds of this: experiments/studies/dyna_v6."
SEEDS = "One seed shows how it works; experiments/studies has the claims, over many seeds and with controls."


def main(arguments: Sequence[str]) -> Answer:
    """Run the main job; answers with its tables."""
    flags = parser(
        "quickstart",
        "Play the inverted-pendulum core on dm_control's cart-pole without training; train the hopper's core on a walker with "
        "two legs, beside the same budget from scratch; see the first one refused on two poles, which are learnt from scratch.",
    )
    flags.add_argument("--out", type=Path, default=Path("runs/quickstart"), help="folder of the runs and the pictures")
    flags.add_argument("--seed", type=whole("seed", NOT_NEGATIVE), default=0)
    options = flags.parse_args(arguments)
    from transferkit.cli.progress import progress  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.quickstart import quickstart  # noqa: PLC0415

    outcome = quickstart(options.out, progress, seed=options.seed)
    return Answer(asdict(outcome), _describe(outcome, options.seed))


def _describe(outcome: Outcome, seed: int) -> str:
    from transferkit import quickstart as parts  # noqa: PLC0415 - imported by now

    budget = {"steps": parts.STEPS, "episodes": parts.EPISODES, "seed": seed}
    alone = {"steps": parts.POLES.steps, "episodes": parts.POLES.episodes, "seed": seed}
    return "\n\n".join(
        (
            "1. " + TWIN_TEXT.format(core=parts.CORE, twin=parts.TWIN, episodes=parts.TWIN_EPISODES),
            _untrained_table(outcome),
            "2. " + ROBOT_TEXT.format(core=parts.FITTING, robot=parts.ROBOT, **budget),
            _trained_table(outcome.runs, outcome.zero_action),
            f"{ROBOT_STUDY}\nlearning curves: {outcome.picture}",
            "3. " + POLES_TEXT.format(core=parts.CORE, poles=parts.TWO_POLES, refused=outcome.refused),
            ALONE_TEXT.format(**alone),
            _trained_table((outcome.poles,)),
            f"{ALONE_STUDY}\nlearning curve: {outcome.poles_picture}",
            SEEDS,
        )
    )


def _untrained_table(outcome: Outcome) -> str:
    rows = [
        (z.who, f"{z.mean:.0f}", f"{z.low:.0f} to {z.high:.0f}", " ".join(f"{m:.0f}" for m in z.members)) for z in outcome.twin
    ]
    return format_table(("policy", "return", "95 % interval", "each member"), rows)


def _trained_table(runs: Sequence[Result], nothing: ZeroShot | None = None) -> str:
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
    if nothing is not None:
        rows.append((nothing.who, "", 0, 0, "0.0", f"{nothing.mean:.1f}", f"{nothing.low:.1f} to {nothing.high:.1f}"))
    return format_table(("policy", "trainer", "episodes", "env steps", "seconds", "return", "95 % interval"), rows)
