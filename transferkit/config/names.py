"""What the settings are chosen by."""

from __future__ import annotations

from typing import Literal

Algorithm = Literal["ppo", "dyna-ddpg", "dyna-ppo"]
Preset = Literal["default", "paper"]
