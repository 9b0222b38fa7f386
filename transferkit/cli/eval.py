"""`transferkit eval`."""

from __future__ import annotations

from collections.abc import Sequence

from transferkit.cli.answer import Answer, parser, whole
from transferkit.cli.subject import add_subject, subject_of
from transferkit.config.checks import AT_LEAST_ONE


def main(arguments: Sequence[str]) -> Answer:
    """Evaluate the final policy of a run."""
    flags = parser("eval", "Play the final policy of a run, or a core, deterministically.")
    add_subject(flags, episodes=20)
    flags.add_argument(
        "--max-episode-steps",
        type=whole("max_episode_steps", AT_LEAST_ONE),
        help="truncate episodes here; by default as in training",
    )
    options = flags.parse_args(arguments)
    from transferkit.cli.progress import evaluation_progress  # noqa: PLC0415 - torch takes seconds to import
    from transferkit.subject import evaluate_subject  # noqa: PLC0415

    subject = subject_of(options, values=False)
    evaluation = evaluate_subject(
        subject,
        episodes=options.episodes,
        seed=options.seed,
        max_episode_steps=options.max_episode_steps,
        report=evaluation_progress(options.episodes),
    )
    scores = evaluation.scores()
    how = ", wrapped and not trained there" if subject.wrapped else ""
    interval = f", 95 % interval {scores['return_low']:.1f} to {scores['return_high']:.1f}" if scores["n"] > 1 else ""
    episodes = "episode" if scores["n"] == 1 else "episodes"
    text = f"return {scores['return_mean']:.1f}{interval}, {scores['n']} {episodes}, seed {options.seed}\n{subject.env}{how}"
    data = {"run_dir": options.name, "env": subject.env, "wrapped": subject.wrapped, "seed": options.seed, **scores}
    data |= {"returns": evaluation.returns, "lengths": evaluation.lengths}
    return Answer(data, text)
