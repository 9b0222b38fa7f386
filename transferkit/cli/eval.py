"""`transferkit eval`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from transferkit.cli.answer import Answer, parser, whole
from transferkit.cli.environment import add_environment, environment
from transferkit.config.checks import AT_LEAST_ONE, EPISODES, NOT_NEGATIVE


def main(arguments: Sequence[str]) -> Answer:
    """Evaluate the final policy of a run."""
    flags = parser("eval", "Play the final policy of a run deterministically.")
    flags.add_argument("run", metavar="RUN", type=Path, help="directory of a finished training run")
    flags.add_argument("--episodes", type=whole("episodes", EPISODES), default=20)
    flags.add_argument(
        "--seed", type=whole("seed", NOT_NEGATIVE), default=0, help="of the episodes' starts; 0 is the one training reports"
    )
    add_environment(flags, "environment to play in; by default the run's, whose id may import no module")
    flags.add_argument(
        "--max-episode-steps",
        type=whole("max_episode_steps", AT_LEAST_ONE),
        help="truncate episodes here; by default as in training",
    )
    options = flags.parse_args(arguments)
    from transferkit.cli.progress import evaluation_progress  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.subject import evaluate_run, home_of  # noqa: PLC0415

    scores = evaluate_run(
        options.run,
        env=environment(options, lambda: home_of(str(options.run))),
        episodes=options.episodes,
        seed=options.seed,
        max_episode_steps=options.max_episode_steps,
        report=evaluation_progress(options.episodes),
    ).scores()
    interval = f"95 % interval {scores['return_low']:.1f} to {scores['return_high']:.1f}"
    text = f"return {scores['return_mean']:.1f}, {interval}, {scores['n']} episodes, seed {options.seed}"
    return Answer({"run_dir": str(options.run), "seed": options.seed, **scores}, text)
