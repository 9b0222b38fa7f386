"""`transferkit zoo`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import asdict
from statistics import fmean
from typing import TYPE_CHECKING

from transferkit.cli.answer import Answer, parser
from transferkit.cli.endings import USER_ERROR
from transferkit.cli.environment import add_environment, environment
from transferkit.cli.remote_zoo import REMOTE, SUMMARY, add_remote, cells, list_remote
from transferkit.cli.wording import worded
from transferkit.env_id import brief
from transferkit.errors import ConfigError, TransferkitError
from transferkit.table import format_table
from transferkit.zoo.catalog import core_folders, find_card, find_core, list_cards
from transferkit.zoo.summary import Summary

if TYPE_CHECKING:
    from transferkit.zoo.find import Found, Played


def main(arguments: Sequence[str]) -> Answer:
    """List, show, find, verify, pull or push cores."""
    flags = parser("zoo", "The cores that can be wrapped onto an environment.")
    actions = flags.add_subparsers(dest="action", required=True)
    listed = actions.add_parser("list", help="one line a core")
    listed.add_argument("--remote", action="store_true", help="of the zoos elsewhere, as they were when last asked")
    listed.add_argument("--refresh", action="store_true", help="with --remote: ask them now")
    show = actions.add_parser("show", help="everything about a core")
    show.add_argument("id")
    find = actions.add_parser("find", help="which cores an environment can represent, the one it represents most of first")
    add_environment(find, "the environment", name="env")
    find.add_argument("--play", action="store_true", help="also play each untrained, beside zero action")
    verify = actions.add_parser("verify", help="check hashes, schema and probe outputs")
    verify.add_argument("ids", nargs="*", metavar="ID")
    verify.add_argument("--all", action="store_true", help="every core of the zoo")
    add_environment(verify, "with --rollout: the source environment, if no id makes it again or its module may be run")
    verify.add_argument("--rollout", action="store_true", help="also evaluate every member on its source, against the card")
    add_remote(actions)
    options = flags.parse_args(arguments)
    own = {"list": _list, "show": _show, "find": _find, "verify": _verify}
    return {**own, **REMOTE}[options.action](options)


def _list(options: argparse.Namespace) -> Answer:
    if options.remote:
        return list_remote(options)
    if options.refresh:
        raise ConfigError("only zoos elsewhere are asked", remedy="add {remote=True}")
    cards, errors = list_cards()
    rows = [(card.id, Summary.of(card)) for card in cards]
    _say_errors(errors)
    data = [{"id": name, **asdict(summary)} for name, summary in rows]
    table = format_table(("id", *SUMMARY), [(name, *cells(summary)) for name, summary in rows])
    return Answer(data, table if rows else "no cores found; `transferkit pretrain` makes one")


def _show(options: argparse.Namespace) -> Answer:
    from transferkit.zoo.crossings import read_crossings  # noqa: PLC0415 - the list, which must be instant, needs none
    from transferkit.zoo.readme import render  # noqa: PLC0415

    folder = find_core(options.id)
    card, crossings = find_card(options.id), read_crossings(folder.parent)
    known = [] if crossings is None else [asdict(one) for one in crossings.cores.get(card.id, ())]
    return Answer({**card.to_json(), "untrained": known}, render(card, crossings, options.id))


def _find(options: argparse.Namespace) -> Answer:
    from transferkit.cli.progress import counting_progress  # noqa: PLC0415
    from transferkit.zoo.find import find_cores, play_found  # noqa: PLC0415 - torch takes seconds to import

    env = str(environment(options))
    found, errors = find_cores(env)
    _say_errors(errors)
    if not found:
        return Answer([], f"nothing crosses: {env} represents no input and action of any core")
    header = ["id", "source", "inputs", "actions", "hold", "limbs", "ranges", "distance"]
    table = [
        [
            one.core,
            brief(one.source),
            _share(one.inputs),
            _share(one.actions),
            one.hold,
            one.copies,
            _share(one.reach),
            _apart(one),
        ]
        for one in found
    ]
    data = [asdict(one) for one in found]
    if options.play:
        header += ["untrained", "zero action", "episodes above it"]
        played, failed = play_found(found, env, report=counting_progress("cores played"))
        _say_errors(failed, "not played")
        table = [[*row, *_scores(played.get(one.core))] for row, one in zip(table, found, strict=True)]
        scores = {core: asdict(one) for core, one in played.items()}
        data = [row | scores.get(one.core, {}) for row, one in zip(data, found, strict=True)]
    return Answer(data, format_table(header, table))


def _share(share: float | None) -> str:
    return "-" if share is None else f"{share:.0%}"


def _apart(found: Found) -> str:
    return "-" if found.distance is None else f"{found.distance:.2f}"


def _scores(played: Played | None) -> tuple[str, ...]:
    if played is None:
        return ("-",) * 3
    return f"{fmean(played.returns):.1f}", f"{fmean(played.zero):.1f}", f"{played.better} of {len(played.zero)}"


def _say_errors(errors: Sequence[TransferkitError], what: str = "not listed") -> None:
    for error in errors:
        print(f"transferkit: {what}: {worded(error)}", file=sys.stderr)


def _verify(options: argparse.Namespace) -> Answer:
    from transferkit.zoo.verify import verify  # noqa: PLC0415 - torch takes seconds to import

    if options.all and options.ids:
        raise ConfigError(f"{{all=True}} is every core, and {options.ids[0]} is named", remedy="leave one of them out")
    names = list(core_folders()) if options.all else options.ids
    if not names:
        raise ConfigError("no core to verify", remedy="name one, or use {all=True}", topic="cores")
    env = environment(options)
    if env is not None and not options.rollout:
        raise ConfigError(f"{{env={env}}} has no effect without {{rollout=True}}", remedy="add it, or leave {env} out")
    reports, lines, damaged = [], [], []
    for name in names:
        try:
            reports.append(verify(name, rollout=options.rollout, env=env))
        except TransferkitError as error:
            damaged.append(error)
    for report in reports:
        rolled = f", rolled out {report['rollout_mean']:.1f}" if options.rollout else ""
        lines.append(f"{report['id']}: hashes, schema and probe outputs fit (largest difference {report['probe']:.1e}){rolled}")
    if not reports:
        raise damaged[0]
    _say_errors(damaged, "not verified")
    return Answer(reports, "\n".join(lines), USER_ERROR if damaged else 0)
