"""Packages that only some uses need: imported when they are."""

from __future__ import annotations

import importlib
from types import ModuleType

from transferkit.errors import ConfigError


def import_extra(module: str, extra: str, use: str) -> ModuleType:
    """Import a module of an extra of this package.

    Args:
        module: name, such as `onnxruntime`.
        extra: as in `pip install 'transferkit[EXTRA]'`.
        use: what needs it, as the subject of a sentence.

    Raises:
        ConfigError: it cannot be imported.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ConfigError(
            f"{use} needs {module}, which cannot be imported ({error})", remedy=f"pip install 'transferkit[{extra}]'"
        ) from None
