"""A Sphinx extension: pages that are generated before the docs are built."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import cores
import robots

if TYPE_CHECKING:
    from sphinx.application import Sphinx


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("builder-inited", write)
    return {"parallel_read_safe": True}


def write(app: Sphinx) -> None:
    """Write the pages that are not what they would be now."""
    folder = Path(app.srcdir)
    for name, text in {"cores.md": cores.page(folder / "images" / "robots"), "robots.md": robots.page()}.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
