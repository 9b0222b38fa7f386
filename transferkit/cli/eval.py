"""`transferkit eval`."""

from __future__ import annotations

from collections.abc import Sequence

from transferkit.cli.answer import Answer, parser, whole
from transferkit.cli.environment import add_environment, environment
from transferkit.config.checks import AT_LEAST_ONE, EPISODES, NOT_NEGATIVE


def main(arguments: Sequence[str]) -> Answer:
    """Evaluate the final policy of a run."""
    flags = parser("eval", "Play the final policy of a run, or a core, deterministically.")
    flags.add_argument("name", metavar="RUN|CORE", help="directory of a finished training run, or a core's id or folder")
    flags.add_argument("--episodes", type=whole("episodes", EPISODES), default=20)
    flags.add_argument(
        "--seed", type=whole("seed", NOT_NEGATIVE), default=0, help="of the episodes' starts; 0 is the one training reports"
    )
    add_environment(flags, "environment to play in; a core or a run is wrapped onto another than its own")
    flags.add_argument("--member", type=whole("member", NOT_NEGATIVE), help="which of a core's source seeds, by default 0")
    flags.add_argument(
        "--max-episode-steps",
        type=whole("max_episode_steps", AT_LEAST_ONE),
        help="truncate episodes here; by default as in training",
    )
    options = flags.parse_args(arguments)
    from transferkit.cli.progress import evaluation_progress  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.subject import evaluate_subject, home_of, load_subject  # noqa: PLC0415

    env = environment(options, lambda: home_of(options.name))
    subject = load_subject(options.name, env=env, member=options.member, values=False)
    scores = evaluate_subject(
        subject,
        episodes=options.episodes,
        seed=options.seed,
        max_episode_steps=options.max_episode_steps,
        report=evaluation_progress(options.episodes),
    ).scores()
    how = ", wrapped and not trained there" if subject.wrapped else ""
    interval = f", 95 % interval {scores['return_low']:.1f} to {scores['return_high']:.1f}" if scores["n"] > 1 else ""
    text = f"return {scores['return_mean']:.1f}{interval}, {scores['n']} episodes, seed {options.seed}\n{subject.env}{how}"
    data = {"run_dir": options.name, "env": subject.env, "wrapped": subject.wrapped, "seed": options.seed, **scores}
    return Answer(data, text)
