"""Independent random streams from one seed, by name, so that arms of a comparison share those they have in common."""

from __future__ import annotations

import zlib

import numpy as np
import torch

from transferkit.config.checks import Seed, check_value


class Streams:
    """Named random streams spawned from one seed (numpy's `SeedSequence`); the same name gives the same stream.

    Raises:
        SettingError: the seed is not a whole number from 0 to 2**63 - 1.
    """

    def __init__(self, seed: int) -> None:
        check_value("seed", seed, Seed)
        self.seed = int(seed)

    def integer(self, name: str, *index: int) -> int:
        """Draw a 32-bit seed for the stream's element `index`, to hand to somebody else's `seed=`."""
        return int(self._sequence(name, index).generate_state(1)[0])

    def episode(self, k: int) -> int:
        """The seed that episode `k` starts from wherever a policy is played and not trained."""
        return self.integer("evaluation", k)

    def numpy(self, name: str) -> np.random.Generator:
        """Make a NumPy generator."""
        return np.random.default_rng(self._sequence(name, ()))

    def torch(self, name: str, device: torch.device | str = "cpu") -> torch.Generator:
        """Make a torch generator on the device."""
        generator = torch.Generator(device)
        return generator.manual_seed(int(self._sequence(name, ()).generate_state(1, np.uint64)[0] >> 1))

    def _sequence(self, name: str, index: tuple[int, ...]) -> np.random.SeedSequence:
        return np.random.SeedSequence(self.seed, spawn_key=(zlib.crc32(name.encode()), *index))
