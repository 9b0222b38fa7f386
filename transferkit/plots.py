"""Plots of runs: learning curves, errors of a learnt model, traces of a recording."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import numpy as np

from transferkit.config import TrainConfig
from transferkit.errors import ConfigError, RecordingError, RunDirectoryError, printable, reason_of
from transferkit.files import new_file
from transferkit.record.mapping import load_mapping, read_logged
from transferkit.record.reader import read, spec_of
from transferkit.run import EpisodeRow, EvaluationRow, ModelRow, read_record, read_table

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

if TYPE_CHECKING:
    from transferkit.record.mapping import ChannelMap

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


@dataclass(frozen=True)
class Traces:
    """An episode of a recording, to be drawn."""

    title: str
    time: NDArray[np.floating]
    unit: str
    panels: Mapping[str, Sequence[Mapping[str, float]]]
    """Rows of values by the element's name."""
    reward: Sequence[float]
    value: Sequence[float] = ()


def draw_recording(recording: Path, path: Path, *, episode: int = 0, mapping: Path | None = None) -> None:
    """Draw an episode of a recording: observation, what the core sees and makes of it, action, reward.

    Args:
        recording: of ours, or with a mapping of any tool.
        path: the picture.
        episode: its number; in other tools' files the ends that the mapping names are counted.
        mapping: says where another tool's recording has what.

    Raises:
        RecordingError: not a recording of ours and no mapping, a mapping that does not fit, or no such episode.
    """
    traces = _own(recording, episode) if mapping is None else _mapped(recording, load_mapping(mapping), episode)
    rows = len(traces.panels) + 1
    figure, axes = plt.subplots(rows, 1, figsize=(11, 2.4 * rows), sharex=True, layout="constrained")
    for axis, (name, values) in zip(axes, traces.panels.items(), strict=False):
        _draw_traces(axis, traces.time, name, values)
    axes[-1].plot(traces.time, traces.reward, color=COLOURS[0], label="reward")
    if traces.value:
        axes[-1].plot(traces.time, traces.value, "--", color=COLOURS[1], label="value, in the critic's scale")
    axes[-1].legend(loc="upper left", fontsize="x-small")
    axes[-1].set_xlabel(traces.unit)
    figure.suptitle(verbatim(traces.title))
    save_figure(figure, path)


def _own(recording: Path, episode: int) -> Traces:
    contents = read(recording)
    spec = spec_of(contents, recording)
    steps = [step for step in contents.steps if step.episode == episode]
    if not steps:
        raise _no_episode(recording, episode, contents.steps[-1].episode)
    return Traces(
        f"{spec.env_id}, episode {episode}: return {steps[-1].return_:.1f}",
        np.arange(len(steps)) * (spec.time_step or 1.0),
        "simulated seconds" if spec.time_step else "steps",
        {name: [getattr(step, name) for step in steps] for name in TRACES if getattr(steps[0], name)},
        [step.reward for step in steps],
        [] if steps[0].value is None else [np.nan if step.value is None else step.value for step in steps],
    )


def _mapped(recording: Path, channels: ChannelMap, episode: int) -> Traces:
    logged = read_logged(recording, channels)
    rows = np.flatnonzero((episodes := logged.episodes()) == episode)
    if not len(rows):
        raise _no_episode(recording, episode, int(episodes.max()))
    reward = logged.reward[rows, 0]
    panels = {
        "observation": [dict(zip(channels.observation.fields, row, strict=True)) for row in logged.observation[rows].tolist()],
        "action": [dict(zip(channels.action.fields, row, strict=True)) for row in logged.action[rows].tolist()],
    }
    title = f"{recording.name}, episode {episode}: return {np.nansum(reward):.1f}"
    return Traces(title, (logged.times[rows] - logged.times[rows[0]]) / 1e9, "seconds in the log", panels, reward.tolist())


def _no_episode(recording: Path, episode: int, last: int) -> RecordingError:
    known = f"use {{episode=0}}{f' to {last}' if last else ''}"
    return RecordingError(f"{recording} has no step of episode {episode}", remedy=known)


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
            raise ConfigError(f"{path} cannot be drawn: {reason_of(error)}") from None
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
