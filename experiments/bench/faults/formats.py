"""The formats that are read: of each a whole sample, ways to damage and to forge it, and the readers it goes through.

Damaged files are as they were but for some bytes: a reader refuses them, or reads what was written. Forged ones have right
checksums, as a stranger can make them: a reader refuses them, or reads data of the declared types that can be used.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.torch
import torch

from experiments.bench.faults import mutate
from transferkit.reading import sealed
from transferkit.tensors import dump_tensors, parse_tensors

Random = np.random.Generator

RELEASED, ENV = "inverted-pendulum-v1", "InvertedPendulum-v5"
"""A core of the zoo, and its source."""


class WrongError(Exception):
    """A reader took a file for something that it is not."""


@dataclass(frozen=True)
class Format:
    """One kind of file."""

    name: str
    share: float
    """Of all mutants."""
    folder: Path
    """A sample, which is whole."""
    change: Callable[[Path, Random], bool]
    """Changes a copy of the sample in place; True if it is forged."""
    use: Callable[[Path, Random], Any]
    """Reads it; returns something that can be compared."""
    same: Callable[[Any, Any], bool] = lambda found, whole: found == whole
    """Whether what is read of a damaged file is what was written, or is known to be a part of it."""

    def read_whole(self, work: Path) -> object:
        """What is read of the sample."""
        shutil.copytree(self.folder, work)
        return self.use(work, np.random.default_rng(0))

    def trial(self, work: Path, whole: object, random: Random) -> str:
        """Change a copy, read it, and say what came of it.

        Raises:
            TransferkitError: it is refused.
            WrongError: a damaged file was read as something else.
        """
        if work.exists():
            shutil.rmtree(work)
        shutil.copytree(self.folder, work)
        forged = self.change(work, random)
        found = self.use(work, random)
        if mutate.PLANTED in sys.modules:
            raise WrongError("a module was imported that a file names")
        if forged:
            return "usable"
        if not self.same(found, whole):
            raise WrongError(f"a damaged {self.name} was read as another one")
        return "equal"


def damage(path: Path, random: Random) -> bool:
    """Change bytes of a file."""
    path.write_bytes(mutate.in_bytes(path.read_bytes(), random))
    return False


def forge_json(path: Path, random: Random) -> bool:
    """Change values of a sealed JSON file, and seal it again."""
    data = mutate.in_json({name: value for name, value in json.loads(path.read_text()).items() if name != "digest"}, random)
    path.write_bytes(mutate.as_text(_sealed(data), random))
    return True


def forge_state(path: Path, random: Random) -> bool:
    """Change values, tensors or bytes of a file of tensors, and write its checksum again."""
    tensors, metadata = parse_tensors(path.read_bytes())
    if metadata and random.random() < 0.5:
        tree = mutate.in_json(json.loads(metadata["tree"]), random)
        metadata = {"tree": mutate.as_text(tree, random).decode(errors="surrogateescape").encode(errors="replace").decode()}
        path.write_bytes(dump_tensors(tensors, metadata))
    elif random.random() < 0.8:
        path.write_bytes(dump_tensors(forge_tensors(tensors, random), metadata))
    else:
        damage(path, random)
    return True


def forge_tensors(tensors: Mapping[str, torch.Tensor], random: Random) -> dict[str, torch.Tensor]:
    """Change a tensor: a number, its shape, its type, its name; or leave it out, or add one."""
    tensors = dict(tensors)
    name = str(random.choice(sorted(tensors)))
    tensor = tensors[name].clone()
    way, at = int(random.integers(9)), int(random.integers(max(1, tensor.numel())))
    if way == 0 and tensor.is_floating_point() and tensor.numel():
        bad = float(random.choice([np.nan, np.inf, -np.inf, 3e38, -1.0, 1e-45]))
        tensor.view(-1)[at] = bad
        tensors[name] = tensor
    elif way == 1:
        tensors[name] = tensor.reshape(-1)[:at].clone()
    elif way == 2:
        tensors[name] = tensor.unsqueeze(0).repeat(2, *[1] * tensor.dim())
    elif way == 3:
        tensors[name] = tensor.to([torch.float16, torch.int64, torch.bool, torch.float64][at % 4])
    elif way == 4:
        del tensors[name]
    elif way == 5:
        tensors[f"{name}x"] = tensors.pop(name)
    elif way == 6:
        tensors["policy/extra"] = torch.zeros(3)
    elif way == 7:
        tensors[name] = tensor.flip(0).contiguous() if tensor.dim() else tensor + 1
    else:
        other = str(random.choice(sorted(tensors)))
        tensors[name], tensors[other] = tensors[other].clone(), tensor
    return tensors


def forge_header(blob: bytes, random: Random) -> bytes:
    """Change the header of a safetensors file, whose sizes it declares."""
    end = 8 + int.from_bytes(blob[:8], "little")
    text = mutate.as_text(mutate.in_json(json.loads(blob[8:end]), random), random)
    return len(text).to_bytes(8, "little") + text + blob[end:]


def save_tensors(tensors: Mapping[str, torch.Tensor]) -> bytes:
    """As an artifact has them, whose card has the checksum."""
    return safetensors.torch.save({name: tensor.contiguous() for name, tensor in tensors.items()})


def sha256(data: bytes) -> str:
    """The checksum."""
    return hashlib.sha256(data).hexdigest()


def _sealed(data: Any) -> Any:  # noqa: ANN401 - JSON
    try:
        return sealed(data)
    except (ValueError, AttributeError, TypeError):  # NaN has no checksum, and a list no name for it
        return {**data, "digest": "0" * 64} if isinstance(data, dict) else data
