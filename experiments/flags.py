"""How the commands of this package word an error's options."""

from __future__ import annotations


def in_flags(name: str, value: str | None) -> str:
    """An option as a flag."""
    flag = f"--{name.replace('_', '-')}"
    return flag if value is None or value == "True" else f"{flag} {value}"
