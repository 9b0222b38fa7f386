"""Files of other libraries as cores that no zoo holds."""

from __future__ import annotations

import logging
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from transferkit.envs import derive_spec
from transferkit.errors import ConfigError, DimensionError
from transferkit.interop import Given, read_core

if TYPE_CHECKING:
    from transferkit.policy.core import Core


def imported(file: Path, env: str | None) -> Core:
    """Make a core of a file that says all that is needed, and log what it was taken for.

    Raises:
        ArtifactError: it is damaged, or of no known format.
        ConfigError: no environment is named, or the file does not say something.
        DimensionError: it does not fit the environment.
    """
    if file.suffix == ".mcap":
        raise ConfigError(
            f"{file} is a recording and not a policy", remedy="name a core or a run; `transferkit replay` plays it"
        )
    if env is None:
        raise ConfigError(f"{file} does not say its environment", remedy="give {env}, the one that it was trained in")
    try:
        core, foreign, notes = read_core(file, derive_spec(env), Given(), file.stem)
    except (ConfigError, DimensionError) as error:
        first = f"make a core of it first, `transferkit import {shlex.quote(str(file))} --env SOURCE --name NAME`"
        raise type(error)(error.what, remedy=f"{first}: {error.remedy}") from None
    said = "".join(f"; {note}" for note in notes)
    logging.getLogger("transferkit").warning("%s is taken as a policy of %s (%s)%s", file, env, foreign.library, said)
    return core
