"""`transferkit eval`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Answer, parser, whole
from transferkit.config.checks import EPISODES, NOT_NEGATIVE


def main(arguments: Sequence[str]) -> Answer:
    """Evaluate the final policy of a run."""
    flags = parser("eval", "Play the final policy of a run deterministically.")
    flags.add_argument("run", metavar="RUN", type=Path, help="directory of a finished training run")
    flags.add_argument("--episodes", type=whole("episodes", EPISODES), default=20)
    flags.add_argument(
        "--seed", type=whole("seed", NOT_NEGATIVE), default=0, help="of the episodes' starts; 0 is the one training reports"
    )
    options = flags.parse_args(arguments)
    from transferkit.subject import evaluate_run  # noqa: PLC0415 - torch takes seconds to import

    scores = evaluate_run(options.run, episodes=options.episodes, seed=options.seed).scores()
    interval = f"95 % interval {scores['return_low']:.1f} to {scores['return_high']:.1f}"
    text = f"return {scores['return_mean']:.1f}, {interval}, {scores['n']} episodes, seed {options.seed}"
    return Answer({"run_dir": str(options.run), "seed": options.seed, **scores}, text)
