"""`transferkit zoo add`, `remove`, `pull`, `push` and `list --remote`."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from transferkit.cli.answer import Answer
from transferkit.env_id import brief
from transferkit.errors import SettingError
from transferkit.table import format_table
from transferkit.zoo.catalog import core_folders
from transferkit.zoo.remote.roots import Root, cached_index, forget, remember, roots

if TYPE_CHECKING:
    from transferkit.zoo.remote.index import Index
    from transferkit.zoo.summary import Summary

SUMMARY = ("source", "obs", "act", "components", "members", "score", "95 % interval", "threshold")
"""Header of what is said about a core."""

URL = "URL of a zoo: a folder, http(s)://, s3://, gs:// or hf://"


def cells(summary: Summary) -> tuple[Any, ...]:
    """A core's line of a table."""
    shape = brief(summary.source_env), summary.obs_dim, summary.act_dim, ", ".join(summary.parts), summary.members
    score = f"{summary.score_mean:.1f}", f"{summary.score_low:.1f} to {summary.score_high:.1f}", f"{summary.threshold:g}"
    return *shape, *score


def add_remote(actions: Any) -> None:  # noqa: ANN401 - argparse keeps the type of subparsers for itself
    """Add the flags of these commands."""
    add = actions.add_parser("add", help="remember a zoo elsewhere, from which cores can be pulled")
    add.add_argument("url", help=URL)
    add.add_argument("--expect", metavar="DIGEST", help="believe no other index than the one with this sha256")
    remove = actions.add_parser("remove", help="forget a zoo elsewhere; what was pulled stays")
    remove.add_argument("url", help="URL of a zoo that was added")
    pull = actions.add_parser("pull", help="bring a core from a zoo elsewhere; it is then found by its id")
    pull.add_argument("id")
    pull.add_argument("--from", dest="url", metavar="URL", help="the zoo, if several have it")
    push = actions.add_parser("push", help="copy a core into a zoo elsewhere, which keeps every version that it has")
    push.add_argument("folder", type=Path, help="a core's folder")
    push.add_argument("url", help=URL)


def list_remote(options: argparse.Namespace) -> Answer:
    """Show the cores of all zoos that were added."""
    rows, added = [], roots()
    for root in added:
        index = _asked(root) if options.refresh else cached_index(root)
        if index is None:
            print(f"transferkit: nothing is known of {root.url}; `transferkit zoo list --remote --refresh`", file=sys.stderr)
        rows += [(name, entry.summary, root.url) for name, entry in (index.cores if index else {}).items()]
    data = [{"id": name, **asdict(summary), "zoo": url} for name, summary, url in rows]
    table = format_table(("id", *SUMMARY, "zoo"), [(name, *cells(summary), url) for name, summary, url in rows])
    if not rows:
        table = "no cores in them" if added else "no zoos elsewhere; `transferkit zoo add URL` adds one"
    return Answer(data, table)


def _asked(root: Root) -> Index | None:
    from transferkit.zoo.remote.fetch import current  # noqa: PLC0415 - heavy

    return current(root)


def _add(options: argparse.Namespace) -> Answer:
    from transferkit.zoo.remote.fetch import refresh  # noqa: PLC0415

    url = options.url if "://" in options.url or not options.url.strip() else str(Path(options.url).absolute())
    root = Root(url.rstrip("/"), _digest(options.expect))
    index, digest = refresh(root)
    remember(root)
    data = {"url": root.url, "cores": list(index.cores), "digest": digest}
    count = f"{len(index.cores)} core{'s' * (len(index.cores) != 1)}"
    return Answer(data, f"{root.url} has {count}; its index has the digest {digest}")


def _digest(text: str | None) -> str | None:
    if text is not None and re.fullmatch("[0-9a-f]{64}", text) is None:
        raise SettingError("expect", value=text, allowed="64 hexadecimal digits, which `zoo push` and `zoo add` say")
    return text


def _remove(options: argparse.Namespace) -> Answer:
    root = forget(options.url)
    return Answer({"url": root.url}, f"{root.url} is forgotten; what was pulled from it stays")


def _pull(options: argparse.Namespace) -> Answer:
    from transferkit.cli.progress import counting_progress  # noqa: PLC0415
    from transferkit.zoo.remote.fetch import pull  # noqa: PLC0415

    before = core_folders().get(options.id)
    folder = pull(options.id, options.url, counting_progress("bytes"))
    text = f"{options.id} is in {folder}" + (", as it was before" if folder == before else "")
    return Answer({"id": options.id, "folder": str(folder)}, text)


def _push(options: argparse.Namespace) -> Answer:
    from transferkit.zoo.remote.push import push  # noqa: PLC0415

    name, digest = push(options.folder, options.url)
    text = f"{name} is in {options.url}; its index now has the digest {digest}, for `transferkit zoo add URL --expect`"
    return Answer({"id": name, "url": options.url, "digest": digest}, text)


REMOTE: Mapping[str, Callable[[argparse.Namespace], Answer]] = {
    "add": _add,
    "remove": _remove,
    "pull": _pull,
    "push": _push,
}
"""By the name of the action."""
