"""Commands that write, each as small as it can be."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import experiments.matrix.__main__ as matrix
import experiments.report.__main__ as report
from experiments.bench.kills.jobs import CORE, ENV, GRID, PPO, SETTINGS, no_pool
from experiments.matrix import runner
from transferkit.cli import main as transferkit


@dataclass(frozen=True)
class Case:
    """A command, with `{out}` and `{inputs}` for the full disk and a folder with what it reads."""

    name: str
    main: Callable[[Sequence[str]], int]
    command: str
    resume: str = ""
    """What is added to go on."""
    reads: str = ""
    """Command whose results it reads."""

    def run(self, out: Path, inputs: Path, *, again: bool = False) -> int:
        """Run it here; returns the exit code."""
        free = next(path for k in range(9) if not (path := out / f"played_{k}.mcap").exists())
        words = f"{self.command} {self.resume if again else ''}".split()
        return self.main([word.format(out=out, inputs=inputs, free=free) for word in words])


def flags(settings: Mapping[str, object]) -> str:
    """Settings as flags."""
    words = []
    for name, value in settings.items():
        values = value if isinstance(value, tuple) else (value,)
        words += [f"--{name.replace('_', '-')}", *map(str, values)]
    return " ".join(words)


def run_matrix(arguments: Sequence[str]) -> int:
    """Run a matrix in this process."""
    Path(arguments[0]).write_text(GRID)
    here = {"worker_pool": no_pool, "plan": lambda *_: "", "import_beside": lambda *_: None}
    with mock.patch.multiple(runner, **here):
        return matrix.main(arguments)


SMALL = f"--env {ENV} --steps 130 --eval-every 60 --eval-episodes 1 --checkpoint-seconds 0"
ALIKE = f"--env {ENV} --steps 70 --eval-episodes 1 --checkpoint-seconds 0 {flags(PPO)}"
"""Without evaluations before the end."""

CASES = (
    Case("train", transferkit.main, f"train {SMALL} {flags(PPO)} --out {{out}}/run", "--resume"),
    Case(
        "train with a model",
        transferkit.main,
        f"train --algo dyna-ddpg {SMALL} {flags(SETTINGS['dyna-ddpg'])} --out {{out}}/run",
        "--resume",
    ),
    Case("record", transferkit.main, f"record {CORE} --out {{free}}"),
    Case("matrix", run_matrix, "{inputs}/grid.toml --out {out}/out"),
    Case("report", report.main, "{inputs}/matrix/out --out {out}/report.html", reads="matrix"),
    Case("pretrain", transferkit.main, f"pretrain --name small --threshold 0 --seeds 0 1 --workers 1 {ALIKE}"),
    Case("export", transferkit.main, f"export {CORE} --out {{out}}/policy.onnx"),
    Case("plot", transferkit.main, "plot {inputs}/train/run --out {out}/curves.png", reads="train"),
)
