"""Plots of runs: learning curves, errors of a learnt model, traces of a recording."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np

from transferkit.config import TrainConfig
from transferkit.errors import ConfigError, RecordingError, RunDirectoryError, printable
from transferkit.files import new_file
from transferkit.record.reader import read, spec_of
from transferkit.run import EpisodeRow, EvaluationRow, ModelRow, read_record, read_table

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

WINDOW = 20
"""Episodes of the running mean."""

Table = Mapping[str, NDArray[np.float64]]
"""A run's table by column."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
"""Okabe and Ito's colour-blind safe palette."""

KINDS, LONGEST_NAME = ("jpg", "pdf", "png", "svg"), 100
"""Of files, and characters of a name that are drawn."""

TRACES = ("observation", "core_input", "core_output", "action")
MOST_TRACES = 12
"""Lines in one panel."""

MODEL_PANELS: Mapping[str, Mapping[str, str]] = {
    "observation error / deviation": {"error_1": "1 step", "error_5": "5 steps", "error_20": "20 steps"},
    "in units of the targets": {"disagreement": "members' disagreement", "reward_error": "reward error"},
    "share": {"termination_accuracy": "right about the end", "terminations_found": "ends foreseen"},
}


def draw_learning_curves(runs: Mapping[str, Path], title: str, path: Path, *, zero_action: float | None = None) -> None:
    """Draw training returns of runs by label, over episodes and over environment steps: each episode, and a running mean."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 4), sharey=True, layout="constrained")
    for (label, run), colour in zip(runs.items(), COLOURS, strict=False):
        _draw_returns(axes, run, verbatim(label), colour)
    for axis in axes:
        if zero_action is not None:
            axis.axhline(zero_action, color="grey", linestyle=":")
    axes[0].set_ylabel(f"return (line: mean of {WINDOW} episodes)")
    axes[0].set_title(verbatim(title))
    axes[1].set_title("" if zero_action is None else "dotted: zero action")
    axes[0].legend()
    save_figure(figure, path)


def draw_run(run: Path, path: Path) -> None:
    """Draw a run's learning curve with its evaluations, and below it its model's errors if it has a model.

    Raises:
        RunDirectoryError: there is no run, or no finished episode yet.
    """
    config = TrainConfig.from_json(read_record(run))
    if not len(read_table(run, EpisodeRow)["episode"]):
        raise RunDirectoryError(f"{run} has no finished episode yet", remedy="train longer, then plot")
    model = read_table(run, ModelRow) if ModelRow.file(run).exists() else None
    rows, panels = (1, 2) if model is None else (2, 3)
    figure, axes = plt.subplots(rows, panels, figsize=(12, 4 * rows), layout="constrained", squeeze=False)
    _draw_returns(axes[0], run, "training", COLOURS[0])
    _draw_evaluations(axes[0][:2], read_table(run, EvaluationRow))
    figure.suptitle(verbatim(f"{config.env}, {config.algo}, {config.core or 'scratch'}, seed {config.seed}"))
    axes[0][0].set_ylabel(f"return (line: mean of {WINDOW} episodes)")
    axes[0][0].legend()
    if model is not None:
        axes[0][2].set_axis_off()
        _draw_model(axes[1], model)
    save_figure(figure, path)


def draw_recording(recording: Path, path: Path, *, episode: int = 0) -> None:
    """Draw an episode of a recording: observation, what the core sees and makes of it, action, reward.

    Raises:
        RecordingError: not a recording of ours, or no such episode in it.
    """
    contents = read(recording)
    spec = spec_of(contents, recording)
    steps = [step for step in contents.steps if step.episode == episode]
    if not steps:
        raise RecordingError(f"{recording} has no step of episode {episode}", remedy="use {episode=0}")
    panels = [name for name in TRACES if getattr(steps[0], name)]
    figure, axes = plt.subplots(len(panels) + 1, 1, figsize=(11, 2.4 * len(panels) + 2.4), sharex=True, layout="constrained")
    seconds = np.arange(len(steps)) * (spec.time_step or 1.0)
    for axis, name in zip(axes, panels, strict=False):
        _draw_traces(axis, seconds, name, [getattr(step, name) for step in steps])
    axes[-1].plot(seconds, [step.reward for step in steps], color=COLOURS[0], label="reward")
    if steps[0].value is not None:
        values = [np.nan if step.value is None else step.value for step in steps]
        axes[-1].plot(seconds, values, "--", color=COLOURS[1], label="value, in the critic's scale")
    axes[-1].legend(loc="upper left", fontsize="x-small")
    axes[-1].set_xlabel("simulated seconds" if spec.time_step else "steps")
    figure.suptitle(verbatim(f"{spec.env_id}, episode {episode}: return {steps[-1].return_:.1f}"))
    save_figure(figure, path)


def _draw_traces(axis: Axes, seconds: NDArray[np.floating], name: str, rows: Sequence[Mapping[str, float]]) -> None:
    for k, element in enumerate(list(rows[0])[:MOST_TRACES]):
        style = ("-", "--", ":")[k // len(COLOURS)]
        values, colour = [row.get(element, np.nan) for row in rows], COLOURS[k % len(COLOURS)]
        axis.plot(seconds, values, style, color=colour, label=verbatim(element), linewidth=1)
    more = f", first {MOST_TRACES} of {len(rows[0])}" if len(rows[0]) > MOST_TRACES else ""
    axis.set_ylabel(f"{name.replace('_', ' ')}{more}")
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="x-small")


def verbatim(text: str) -> str:
    """Write a name from outside so that matplotlib shows it as it is, without mathematics, and in the legend."""
    return (" " if text.startswith("_") else "") + printable(text, LONGEST_NAME).replace("$", r"\$")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure, all of it or nothing, and close it.

    Raises:
        ConfigError: the file cannot be written, or is of no kind that can be drawn.
    """
    try:
        if path.suffix[1:] not in KINDS:
            raise ConfigError(f"ending of {path}", value=path.suffix, allowed=f".{', .'.join(KINDS)}")
        picture = io.BytesIO()  # matplotlib's PDF fails in its own way on a full disk
        try:
            figure.savefig(picture, format=path.suffix[1:], dpi=110)
        except (ValueError, ArithmeticError) as error:  # matplotlib's words for numbers beyond its axes
            raise ConfigError(f"{path} cannot be drawn: {str(error).splitlines()[0]}") from None
        with new_file(path, "out") as temporary:
            temporary.write_bytes(picture.getvalue())
    finally:
        plt.close(figure)


def _draw_returns(axes: Sequence[Axes], run: Path, label: str, colour: str) -> None:
    table = read_table(run, EpisodeRow)
    returns = table["return"]
    window = np.ones(min(WINDOW, len(returns)))
    mean = np.convolve(returns, window) / np.convolve(np.ones(len(returns)), window)
    for axis, x, name in zip(axes, ("episode", "steps"), ("training episodes", "environment steps"), strict=False):
        axis.plot(table[x], returns, ".", color=colour, alpha=0.25, markersize=4)
        axis.plot(table[x], mean[: len(returns)], color=colour, label=label)
        axis.set_xlabel(name)


def _draw_evaluations(axes: Sequence[Axes], table: Table) -> None:
    means = table["return_mean"]
    spread = np.abs(np.stack((table["return_low"], table["return_high"])) - means)
    for axis, x in zip(axes, ("episodes", "steps"), strict=True):
        axis.errorbar(table[x], means, spread, fmt="s", color=COLOURS[1], markersize=4, label="evaluation, 95 % interval")


def _draw_model(axes: Sequence[Axes], table: Table) -> None:
    for axis, (title, columns) in zip(axes, MODEL_PANELS.items(), strict=True):
        for (column, label), colour in zip(columns.items(), COLOURS, strict=False):
            axis.plot(table["steps"], table[column], ".-", color=colour, label=label)
        axis.set_xlabel("environment steps")
        axis.set_ylabel(title)
        axis.legend()
    axes[0].set_yscale("log")
    axes[1].set_yscale("log")
    axes[0].set_title("model, on transitions it has not seen")
