"""What a core means on another environment, before it is wrapped."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from transferkit.config import preset_of
from transferkit.config.wrap import FOUND
from transferkit.envs import derive_spec
from transferkit.errors import UnknownNameError
from transferkit.matching import find_pairing
from transferkit.policy.core import Core
from transferkit.spec import IOSpec

if TYPE_CHECKING:
    from transferkit.envs import EnvLike
    from transferkit.pairing import Pairing


def match(
    source: Core | EnvLike | IOSpec,
    target: EnvLike | IOSpec,
    *,
    preset: str = "default",
    **options: Any,  # noqa: ANN401 - of `FOUND`
) -> Pairing:
    """Find how a core, or what is trained on an environment, stands on another one; nothing is trained or played.

    Args:
        source: a core, or its environment in any form that `make_env` takes, or a spec.
        target: the other environment, or its spec.
        preset: whose settings to match by.
        **options: over the preset: `limbs`, `angles`, `forces`, `hold`, `stagger` of `WrapConfig`.

    Raises:
        UnknownNameError: an unknown option, preset or environment.
        SettingError: an option out of its range.
    """
    for name in options:
        if name not in FOUND:
            raise UnknownNameError("option of match", name, FOUND)
    config = replace(preset_of("ppo", preset).wrap, **options)
    specs = [source.spec if isinstance(source, Core) else _spec(source), _spec(target)]
    return find_pairing(config, *specs)


def _spec(env: EnvLike | IOSpec) -> IOSpec:
    return env if isinstance(env, IOSpec) else derive_spec(env)
