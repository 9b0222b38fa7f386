"""What a play may be written as, and how long."""

from __future__ import annotations

from transferkit.config.checks import Range

VIDEO, STRIP = ".mp4", ".png"
"""Endings of a file."""

SECONDS, SECONDS_ALLOWED = 10, Range(1, 3600)
"""Simulated seconds that a file shows at most: by default, and what may be asked for."""
