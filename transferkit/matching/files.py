"""Matches as files that a person may edit: JSON or YAML, checked against the specs they are of."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from transferkit.config.checks import check_kind
from transferkit.env_id import EnvId
from transferkit.errors import ConfigError, UnknownNameError
from transferkit.files import check_new, new_file
from transferkit.matching.limits import Limit, Unlike
from transferkit.matching.unmatched import Unmatched
from transferkit.pairing import Pairing
from transferkit.reading import FormatError, parse_yaml, read_bytes, typed

if TYPE_CHECKING:
    from transferkit.pairing import Combination, Copy
    from transferkit.spec import Actuator, IOSpec, Joint

Value = TypeVar("Value")

LOGGER = logging.getLogger("transferkit")

LARGEST = 1_000_000
"""Bytes of a match file."""

HEAD = """\
# How a core of {source} stands on {target}. Edit it and hand it back: wrap(core, env, match=FILE), --match FILE.
# joints: what each joint of the core's robot reads of the target's, with signs. actions: what drives each actuator.
# Joints and actuators may also be called what their models call them.
# shift: added to what a joint reads. inputs: core inputs read from elements of the observation, whatever the joints say.
# forces: how the factors of the actions were found. To change them, change the factors, or match again with another --forces.
"""


def save_match(pairing: Pairing, path: str | Path, left_out: Iterable[Unmatched] = ()) -> None:
    """Write a match as YAML, with what is left out as comments.

    Raises:
        ConfigError: the file exists, its folder does not, it cannot be written, or its name does not end in .yaml.
    """
    import yaml  # noqa: PLC0415 - most commands write none

    check_kind("pairing", pairing, Pairing, "give what transferkit.match returns")
    check_pairing(pairing)
    check_kind("path", path, (str, Path), "give a file that ends in .yaml")
    check_new(Path(path), "yaml", ".yaml")
    text = HEAD.format(source=pairing.source, target=pairing.target)
    text += "".join(f"# not matched: {one.kind} {one.name}: {one.why}\n" for one in left_out)
    text += yaml.safe_dump(as_plain(pairing), sort_keys=False, default_flow_style=None, width=120)
    with new_file(Path(path), "yaml") as temporary:
        temporary.write_text(text)


@dataclass(frozen=True, kw_only=True)
class Report(Pairing):
    """A match with what `transferkit match --json` says of it, which nobody who hands it back has to take out."""

    inputs: float | None = None
    actions: float | None = None
    holds: bool | None = None
    unmatched: list[Unmatched] | None = None
    limits: list[Limit] | None = None
    unlike: list[Unlike] | None = None


def as_plain(pairing: Pairing) -> dict[str, Any]:
    """A match as JSON-ready data, without what is empty."""
    data = asdict(pairing)
    copies = [
        {name: value for name, value in copy.items() if value or name in ("joints", "actions")} for copy in data["copies"]
    ]
    return data | {"copies": copies}


def check_pairing(pairing: Pairing) -> None:
    """Hold a match that was made in Python to what a file's is held to.

    Raises:
        ConfigError: something in it has another type.
    """
    try:
        typed(as_plain(pairing), Report)
    except FormatError as error:
        raise ConfigError(f"the match is none: {error}", topic="matches") from None


def load_match(path: str | Path) -> Pairing:
    """Read a match from a JSON or YAML file.

    Raises:
        ConfigError: it cannot be read, or is none.
    """
    check_kind("path", path, (str, Path), "give a file from transferkit match")
    try:
        read = parse_yaml(read_bytes(Path(path), LARGEST), Report)
        return Pairing(**{field.name: getattr(read, field.name) for field in fields(Pairing)})
    except OSError as error:
        raise ConfigError(f"cannot read the match {path}: {error.strerror}", topic="matches") from None
    except FormatError as error:
        raise ConfigError(
            f"the match {path} is none: {error}", remedy="`transferkit match CORE ENV --yaml FILE` writes one"
        ) from None


def in_canonical_names(pairing: Pairing, source: IOSpec, target: IOSpec) -> Pairing:
    """The same match with canonical names where it has a joint's or an actuator's name in its model.

    Raises:
        ConfigError: it names one under both names.
    """
    own, others = _canonical(source.joints), _canonical(target.joints)
    actuators, driven = _canonical(source.action), _canonical(target.action)
    copies = tuple(
        replace(
            copy,
            joints={name: _renamed(reads, others) for name, reads in _renamed(copy.joints, own).items()},
            shift=_renamed(copy.shift, own),
            actions={name: _renamed(drives, actuators) for name, drives in _renamed(copy.actions, driven).items()},
        )
        for copy in pairing.copies
    )
    return replace(pairing, copies=copies)


def _canonical(parts: Sequence[Joint] | Sequence[Actuator]) -> dict[str, str]:
    """Canonical names by those of the model that only one has, and that are no canonical names themselves."""
    known, times = {part.name for part in parts}, Counter(part.model_name for part in parts)
    return {part.model_name: part.name for part in parts if times[part.model_name] == 1 and part.model_name not in known}


def _renamed(named: Mapping[str, Value], canonical: Mapping[str, str]) -> dict[str, Value]:
    renamed = {canonical.get(name, name): value for name, value in named.items()}
    if len(renamed) < len(named):
        twice = next(name for name in named if canonical.get(name) in named)
        raise ConfigError(
            f"the match has {twice} and {canonical[twice]}, which are one", remedy="leave one out", topic="matches"
        )
    return renamed


def check_match(pairing: Pairing, source: IOSpec, target: IOSpec) -> None:
    """Compare a match in canonical names with the specs of a core and of a target.

    Raises:
        ConfigError: it is of other environments, or has something that reads nothing.
        UnknownNameError: it names a joint, an actuator or an element that is not there.
    """
    for side, named, spec in (("source", pairing.source, source), ("target", pairing.target, target)):
        if EnvId.read(named).id != EnvId.read(spec.env_id).id:
            raise ConfigError(
                f"the match has {side} {named}, and is used with {spec.env_id}",
                remedy=f"use the one of that pair, or write {side}: {spec.env_id} into it",
                topic="matches",
            )
        if "?" in named and named != spec.env_id:
            LOGGER.warning("the match was made for %s, and is used with %s", named, spec.env_id)
    for k, copy in enumerate(pairing.copies):
        _check_copy(copy, source, target)
        reads, drives = copy.joints or copy.inputs, any(any(factors.values()) for factors in copy.actions.values())
        if len(pairing.copies) > 1 and not (reads and drives):
            nothing = f"copy {k + 1} of the match {'drives' if reads else 'reads'} nothing"
            raise ConfigError(nothing, remedy="leave it out", topic="matches")


def _check_copy(copy: Copy, source: IOSpec, target: IOSpec) -> None:
    own, others = ([joint.name for joint in spec.joints] for spec in (source, target))
    actuators, driven = ([actuator.name for actuator in spec.action] for spec in (source, target))
    inputs, elements = ([element.name for element in spec.observation] for spec in (source, target))
    _check_names("joint of the source in the match", copy.joints, own)
    _check_names("shifted joint among those that the match reads:", copy.shift, list(copy.joints))
    _check_names("joint of the target in the match", _inner(copy.joints), others)
    _check_names("actuator of the target in the match", copy.actions, driven)
    _check_names("actuator of the source in the match", _inner(copy.actions), actuators)
    _check_names("core input in the match", copy.inputs, inputs)
    _check_names("element of the target in the match", _inner(copy.inputs), elements)
    for kind, combinations in (("joint", copy.joints), ("core input", copy.inputs)):
        for name, combination in combinations.items():
            if not any(combination.values()):
                raise ConfigError(f"{kind} {name} reads nothing in the match", remedy="leave it out", topic="matches")


def _inner(combinations: dict[str, Combination]) -> list[str]:
    return [name for combination in combinations.values() for name in combination]


def _check_names(what: str, names: Iterable[str], known: list[str]) -> None:
    for name in names:
        if name not in known:
            raise UnknownNameError(what, name, known, topic="matches")
