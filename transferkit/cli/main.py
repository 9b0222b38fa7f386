"""The command line: finds the command, prints its answer, and turns errors into one line and exit code 2."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
import threading
from collections.abc import Sequence
from typing import TYPE_CHECKING

from transferkit.cli.answer import JSON_FLAG, Parser
from transferkit.cli.endings import USER_ERROR, ended
from transferkit.cli.streams import check_readable
from transferkit.errors import UnknownNameError

if TYPE_CHECKING:
    from transferkit.cli.answer import Answer

COMMANDS = {
    "quickstart": "the main job on real environments, in under two minutes",
    "zoo": "the cores: list, show ID, find ENV, verify ID...",
    "envs": "the environments: list, show ENV",
    "match": "what of an environment stands for what of a core",
    "train": "train a policy from scratch or around a core",
    "eval": "evaluate the final policy of a run",
    "plot": "learning curve and model errors of a run, traces of a recording",
    "play": "watch a run or a core: in a window, as a video or as pictures",
    "record": "episodes of a run or of a core as an MCAP file",
    "replay": "simulate a recording again: check it, or make a video",
    "recover": "make a whole file of a recording that was cut",
    "export": "a policy as ONNX, recordings as a Minari dataset",
    "import": "a policy of another library as a core",
    "pretrain": "train, check and write a core",
    "distill": "a core that observes less, or otherwise, from one that observes all",
    "doctor": "check this installation and say what to mend",
}
MODULES = {"import": "import_"}
"""Commands whose names Python keeps for itself."""

KEPT = {"train": "; the last checkpoint is intact, --resume goes on from it"} | dict.fromkeys(
    ("pretrain", "distill", "quickstart"), "; the same command goes on from the last checkpoint"
)
"""How a command goes on that a Ctrl-C stopped at once."""

PREFIX = "transferkit: "


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; the exit code is 0, 2 after a mistake, 130 after Ctrl-C."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch is imported; more threads slow small networks down
    threading.excepthook = _one_line
    given = list(sys.argv[1:] if argv is None else argv)
    arguments = [argument for argument in given if argument != JSON_FLAG]
    stopped = f"{PREFIX}stopped at once{KEPT.get(arguments[0], '') if arguments else ''}"
    return ended(lambda: _run(arguments, as_json=len(arguments) < len(given)), prefix=PREFIX, stopped=stopped)


def _run(arguments: Sequence[str], *, as_json: bool) -> int:
    check_readable(arguments)
    parser = _parser()
    if not arguments:
        parser.print_help()
        return USER_ERROR
    name = parser.parse_args(arguments[:1]).command
    if name not in COMMANDS:
        raise UnknownNameError("command", name, list(COMMANDS), topic="commands")
    answer: Answer = importlib.import_module(f"transferkit.cli.{MODULES.get(name, name)}").main(arguments[1:])
    answer.show(as_json=as_json)
    return answer.code


def _parser() -> Parser:
    lines = "\n".join(f"  {name:<11} {text}" for name, text in COMMANDS.items())
    parser = Parser(
        "transferkit",
        description="Wrap a trained policy core onto another environment, train it there, prove that it helped.",
        epilog=f"commands:\n{lines}\n\n`transferkit COMMAND --help` explains each; every command takes {JSON_FLAG}.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("command", metavar="COMMAND")
    return parser


def _one_line(failure: threading.ExceptHookArgs) -> None:
    """Report a thread that fails in one line; TensorBoard's writer hands what went wrong to whoever writes next."""
    if type(failure.thread).__name__ != "_AsyncWriterThread":
        print(f"{PREFIX}a background writer stopped: {failure.exc_value}", file=sys.stderr)
