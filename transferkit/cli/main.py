"""The command line: finds the command, prints its answer, and turns errors into one line and exit code 2."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from transferkit.cli.answer import JSON_FLAG
from transferkit.cli.wording import worded
from transferkit.errors import InterruptedRunError, TransferkitError, UnknownNameError

if TYPE_CHECKING:
    from transferkit.cli.answer import Answer

COMMANDS = {
    "quickstart": "the main job on real environments, in under two minutes",
    "zoo": "the cores: list, show ID, verify ID... | --all",
    "envs": "the environments: list, show ENV",
    "train": "train a policy from scratch or around a core",
    "eval": "evaluate the final policy of a run",
    "plot": "learning curve and model errors of a run, traces of a recording",
    "record": "episodes of a run or of a core as an MCAP file",
    "replay": "simulate a recording again: check it, or make a video",
    "recover": "make a whole file of a recording that was cut",
    "export": "a policy as ONNX, recordings as a Minari dataset",
    "pretrain": "train, check and write a core",
    "doctor": "check this installation and say what to mend",
}
KEPT = {"train": "; the last checkpoint is intact, --resume goes on from it"} | dict.fromkeys(
    ("pretrain", "quickstart"), "; the same command goes on from the last checkpoint"
)
"""How a command goes on that a Ctrl-C stopped at once."""

USER_ERROR, INTERRUPTED, BROKEN_PIPE = 2, 130, 141


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; the exit code is 0, 2 after a mistake, 130 after Ctrl-C."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch is imported; more threads slow small networks down
    threading.excepthook = _one_line
    arguments = list(sys.argv[1:] if argv is None else argv)
    parser = _parser()
    if not arguments:
        parser.print_help()
        return USER_ERROR
    name = parser.parse_args(arguments[:1]).command
    try:
        return _run(name, arguments[1:])
    except BrokenPipeError:  # `| head` has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except KeyboardInterrupt:
        return _say(f"stopped at once{KEPT.get(name, '')}", INTERRUPTED)
    except (TransferkitError, OSError) as error:
        return _say(worded(error), INTERRUPTED if isinstance(error, InterruptedRunError) else USER_ERROR)


def _run(name: str, arguments: Sequence[str]) -> int:
    if name not in COMMANDS:
        raise UnknownNameError("command", name, list(COMMANDS), topic="commands")
    command = importlib.import_module(f"transferkit.cli.{name}")
    answer: Answer = command.main([argument for argument in arguments if argument != JSON_FLAG])
    answer.show(as_json=JSON_FLAG in arguments)
    sys.stdout.flush()
    return answer.code


def _parser() -> argparse.ArgumentParser:
    lines = "\n".join(f"  {name:<11} {text}" for name, text in COMMANDS.items())
    parser = argparse.ArgumentParser(
        "transferkit",
        description="Wrap a trained policy core onto another environment, train it there, prove that it helped.",
        epilog=f"commands:\n{lines}\n\n`transferkit COMMAND --help` explains each; every command takes {JSON_FLAG}.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", metavar="COMMAND")
    return parser


def _say(text: str, code: int) -> int:
    print(f"transferkit: {text}", file=sys.stderr)
    return code


def _one_line(failure: threading.ExceptHookArgs) -> None:
    """Report a thread that fails, such as TensorBoard's writer on a full disk, in one line."""
    print(f"transferkit: a background writer stopped: {failure.exc_value}", file=sys.stderr)
