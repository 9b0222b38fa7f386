"""How a program ends: whatever went wrong is one line and an exit code."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable

from transferkit.cli.streams import drop_output, mend_surroundings
from transferkit.cli.wording import worded
from transferkit.errors import InterruptedRunError, TransferkitError

USER_ERROR, INTERRUPTED, BROKEN_PIPE = 2, 130, 141


def ended(command: Callable[[], int], *, prefix: str = "error: ", stopped: str) -> int:
    """Return the exit code of a command: 2 after a mistake, or if its output cannot be written, 130 after Ctrl-C.

    Args:
        command: returns its exit code.
        prefix: of the line that tells a mistake.
        stopped: the line after a Ctrl-C.
    """
    mend_surroundings()
    try:
        try:
            return command()
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # `| head` has read enough
        return drop_output(BROKEN_PIPE)
    except KeyboardInterrupt:
        return _say(stopped, INTERRUPTED)
    except TransferkitError as error:
        return _say(f"{prefix}{worded(error)}", INTERRUPTED if isinstance(error, InterruptedRunError) else USER_ERROR)
    except OSError as error:  # perhaps of the output
        return drop_output(_say(f"{prefix}{worded(error)}", USER_ERROR))


def _say(text: str, code: int) -> int:
    with contextlib.suppress(OSError):
        print(text, file=sys.stderr)
    return code
