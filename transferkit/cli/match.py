"""`transferkit match`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

from transferkit.cli.answer import Answer, parser, whole
from transferkit.cli.environment import add_environment, environment
from transferkit.config.checks import check_value
from transferkit.config.wrap import APART, FOUND, HELD
from transferkit.errors import ArtifactError, ConfigError, SettingError, UnknownNameError
from transferkit.files import check_new
from transferkit.pairing import Angles, Forces, Limbs
from transferkit.table import format_table

if TYPE_CHECKING:
    from transferkit.spec import IOSpec


def main(arguments: Sequence[str]) -> Answer:
    """Show how a core stands on an environment."""
    flags = parser("match", "Show what of an environment stands for what of a core; nothing is trained or played.")
    flags.add_argument("source", metavar="CORE|RUN|ENV|FILE.yaml", help="a core, a run, an environment or a descriptor")
    add_environment(flags, "the environment that the core is to play in", name="env")
    flags.add_argument("--yaml", type=Path, metavar="FILE", help="write the match, to be edited: for `train --match FILE`")
    flags.add_argument("--limbs", choices=get_args(Limbs), help="let a limb drive one, or all that are like it")
    flags.add_argument("--angles", choices=get_args(Angles), help="read a joint's own angle, or also of joints between")
    flags.add_argument("--forces", choices=get_args(Forces), help="what an action keeps")
    flags.add_argument("--hold", type=whole("hold", HELD), help="control steps of an action; 0 for its own time")
    flags.add_argument("--stagger", type=_number, help="radians between the limbs that a core drives side by side")
    options = flags.parse_args(arguments)
    from transferkit.policy.matches import match  # noqa: PLC0415 - heavy

    if options.source.endswith((".yaml", ".yml")):
        if given := [name for name in (*FOUND, "yaml") if getattr(options, name) is not None]:
            raise ConfigError("a descriptor is compared, and not matched", remedy=f"leave out {{{given[0]}}}")
        return _descriptor(Path(options.source), str(environment(options)))
    if options.yaml is not None:
        check_new(options.yaml, "yaml", ".yaml")
    from transferkit.envs import derive_spec  # noqa: PLC0415 - heavy
    from transferkit.matching import as_plain, compiled, coverage, explain, limits, save_match, unlike, unmatched  # noqa: PLC0415

    source, target = _source(options.source), derive_spec(str(environment(options)))
    given = {name: getattr(options, name) for name in FOUND if getattr(options, name) is not None}
    pairing = match(source, target, **given)
    arrays = compiled(pairing, source, target)
    left_out = unmatched(arrays, source, target)
    if options.yaml is not None:
        save_match(pairing, options.yaml, left_out)
    inputs, actions = coverage(arrays, source)
    data: dict[str, Any] = {"inputs": inputs, "actions": actions, "holds": arrays.holds}
    limited = [asdict(one) for one in limits(arrays, source, target)]
    differing = [asdict(one) for one in unlike(arrays, source, target)]
    data |= {"unmatched": [asdict(one) for one in left_out], "limits": limited, "unlike": differing, **as_plain(pairing)}
    matched = f"{_share(inputs, source.obs_dim)} inputs and {_share(actions, source.act_dim)} actions"
    head = f"{options.source} on {target.env_id}: {matched} are matched"
    note = "" if arrays.holds else "\nnothing crosses: a core that is wrapped there begins with random adapters"
    written = f"\n{options.yaml}: edit it, and hand it to `transferkit train --match {options.yaml}`" if options.yaml else ""
    return Answer(data, f"{head}\n{explain(arrays, source, target)}{note}{written}")


def _check_no_match(path: Path) -> None:
    """Say what a file is that is no descriptor, if it is a match."""
    from transferkit.matching import load_match  # noqa: PLC0415 - heavy

    try:
        load_match(path)
    except ConfigError:
        return
    raise ConfigError(f"{path} is a match", remedy="hand it to {match} of `train`, `eval` or `play`")


def _descriptor(path: Path, env: str) -> Answer:
    """Show where a descriptor and the physics of an environment disagree."""
    from transferkit.descriptors import compare, read_descriptor, remap  # noqa: PLC0415
    from transferkit.envs import derive_spec  # noqa: PLC0415

    try:
        descriptor = read_descriptor(path)
    except ArtifactError:
        _check_no_match(path)
        raise
    spec = derive_spec(env)
    rows, whole = compare(descriptor, spec), remap(descriptor, spec) is not None
    differing = [row for row in rows if row.differs]
    table = [(f"{row.part} {row.index}", row.described, row.measured, row.verdict, row.detail) for row in rows]
    head = f"{path} ({descriptor.format}) and {env}: {len(differing)} of {len(rows)} differ"
    mended = "\n`transferkit import --descriptor` turns a policy to these numbers" if differing and whole else ""
    text = format_table(("number", "the descriptor says", "the physics say", "verdict", "what differs"), table)
    data = {"format": descriptor.format, "notes": descriptor.notes, "mendable": whole, "rows": [asdict(row) for row in rows]}
    return Answer(data, "\n".join([head, text, *descriptor.notes]) + mended)


def _source(name: str) -> IOSpec:
    """The spec that a core was trained with, or an environment's."""
    from transferkit.envs import derive_spec  # noqa: PLC0415 - heavy
    from transferkit.subject import source_spec  # noqa: PLC0415

    try:
        return source_spec(name)
    except UnknownNameError as unknown:
        try:
            return derive_spec(name)
        except UnknownNameError as error:
            raise UnknownNameError("core, run or environment", name, [*unknown.known, *error.known], topic="cores") from None


def _share(share: float, count: int) -> str:
    return f"{round(share * count)} of {count}"


def _number(text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        raise SettingError("stagger", value=text, allowed="a number of radians", topic="flags") from None
    check_value("stagger", number, Annotated[float, APART])
    return number
