"""Zoos elsewhere over HTTP, S3 and a hub's protocol, on loopback: pulled, resumed, never rewritten; liars cost one line."""

import base64
import hashlib
import json
import os
import subprocess
import sys
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from tests.cli.commands import run, run_json
from transferkit.errors import ArtifactError, ConfigError, RemoteError, SettingError
from transferkit.zoo.artifact import load_core
from transferkit.zoo.catalog import find_core
from transferkit.zoo.remote.fetch import pull, refresh
from transferkit.zoo.remote.index import FILES, INDEX, File, Index
from transferkit.zoo.remote.push import push
from transferkit.zoo.remote.roots import Root, cache_folder, remember, roots
from transferkit.zoo.remote.transport import Transport

CORE = "test-v1"


@pytest.fixture(autouse=True)
def _own_folders(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


@pytest.fixture
def zoo(tmp_path, full_core_folder):
    """A zoo in a folder, with one core."""
    push(full_core_folder, str(tmp_path / "zoo"))
    return tmp_path / "zoo"


def silent(done, total):
    assert done <= total


@contextmanager
def serving(answer):
    """An HTTP server on loopback whose every answer `answer(handler, path)` writes."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            answer(self, self.path)

        do_HEAD = do_POST = do_GET  # noqa: N815

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()


def send(handler, data, code=200, **headers):
    handler.send_response(code)
    for name, value in ({"Content-Length": len(data)} | headers).items():
        handler.send_header(name.replace("_", "-"), str(value))
    handler.end_headers()
    if handler.command != "HEAD":
        handler.wfile.write(data)


def files(folder, *, ranges=True, change=lambda _path, data: data):
    """Answers with the files of a folder, from their middle if it is asked to and `ranges`."""

    def answer(handler, path):
        place = folder / path.strip("/")
        if not place.is_file():
            return send(handler, b"", 404)
        data, asked = change(path, place.read_bytes()), handler.headers.get("Range")
        if not ranges or asked is None:
            return send(handler, data, **({"Accept_Ranges": "bytes"} if ranges else {}))
        start, end = (int(part) if part else len(data) - 1 for part in asked.removeprefix("bytes=").split("-"))
        part = data[start : end + 1]
        content = f"bytes {start}-{start + len(part) - 1}/{len(data)}"
        return send(handler, part, 206, Accept_Ranges="bytes", Content_Range=content)

    return answer


def test_a_core_is_pushed_pulled_over_http_and_found_by_its_id_also_offline(zoo, full_core_folder):
    with serving(files(zoo)) as url:
        remember(Root(url))
        refresh(roots()[0])
        with pytest.raises(ConfigError, match=rf"core {CORE} is in the zoo {url} and not here; `transferkit zoo pull {CORE}`"):
            find_core(CORE)
        folder = pull(CORE, None, silent)
    assert find_core(CORE) == folder
    assert load_core(CORE).digest == load_core(full_core_folder).digest
    assert pull(CORE, None, silent) == folder  # the server is gone
    assert not list((cache_folder() / "parts").iterdir())


def test_a_core_that_is_here_already_is_not_pulled_and_another_of_its_id_is_named(zoo, full_core_folder, monkeypatch):
    remember(Root(str(zoo)))
    monkeypatch.setenv("TRANSFERKIT_ZOO", str(full_core_folder.parent))
    assert pull(CORE, None, silent) == full_core_folder
    card = json.loads((full_core_folder / "card.json").read_bytes())
    (full_core_folder / "card.json").write_text(json.dumps(card))  # other bytes
    with pytest.raises(ArtifactError, match=f"there is another core {CORE} in {full_core_folder}"):
        pull(CORE, None, silent)


def test_a_version_is_never_rewritten_and_what_is_no_core_is_not_pushed(zoo, full_core_folder, tmp_path):
    before = (zoo / INDEX).read_bytes()
    with pytest.raises(ArtifactError, match=f"has a core {CORE}, which is never rewritten; choose a higher"):
        push(full_core_folder, str(zoo))
    assert (zoo / INDEX).read_bytes() == before
    (full_core_folder / "core.safetensors").write_bytes(b"no tensors")
    with pytest.raises(ArtifactError, match="is truncated or was changed"):
        push(full_core_folder, str(tmp_path / "other"))
    assert not (tmp_path / "other").exists()
    with serving(files(zoo)) as url, pytest.raises(RemoteError, match="cannot be written; push to a folder, s3://"):
        push(full_core_folder, url)


@pytest.mark.parametrize("ranges", [True, False])
def test_a_broken_download_goes_on_where_it_stopped_or_begins_anew(tmp_path, ranges):
    data = bytes(range(256)) * 4096
    (tmp_path / "file").write_bytes(data)
    asked, part = [], tmp_path / "part"
    whole = files(tmp_path, ranges=ranges)

    def broken(handler, path):
        if handler.command == "HEAD":
            return whole(handler, path)
        handler.send_response(200)
        handler.send_header("Content-Length", str(len(data)))
        handler.end_headers()
        return handler.wfile.write(data[:700_000])

    def noted(handler, path):
        if handler.command == "GET":
            asked.append(handler.headers.get("Range"))
        whole(handler, path)

    with serving(broken) as url, pytest.raises(RemoteError, match="what arrived is kept, and the same command goes on"):
        Transport(url).download("file", File.of(data), part, silent)
    kept = part.stat().st_size
    assert 0 < kept <= 700_000
    with serving(noted) as url:
        Transport(url).download("file", File.of(data), part, silent)
    assert part.read_bytes() == data
    assert asked[0].startswith(f"bytes={kept}-")
    assert (None in asked) == (not ranges)


def endless(handler, path):
    handler.send_response(200)
    handler.end_headers()
    try:
        while handler.command != "HEAD":
            handler.wfile.write(bytes(2**16))
    except OSError:
        pass


def to_a_file(handler, path):
    send(handler, b"", 302, Location="file:///etc/passwd")


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (endless, "has more than 16,777,216 bytes, which are not read"),
        (to_a_file, "is not transferred: NonHttpUrlRedirectClientError: file:///etc/passwd"),
        (lambda handler, path: send(handler, b"<html>"), "the index of .* is not read: not JSON"),
        (lambda handler, path: send(handler, b"", 404), f"is no zoo: it has no {INDEX}"),
        (lambda handler, path: send(handler, b"", 500), "is not transferred: ClientResponseError: 500"),
    ],
    ids=["endless", "redirect to a file", "a page", "nothing", "error"],
)
def test_what_is_no_index_costs_one_line(answer, said):
    with serving(answer) as url, pytest.raises(RemoteError, match=said) as error:
        refresh(Root(url))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data[:-1] + bytes([data[-1] ^ 1]), "has other bytes than the zoo's index says, and is not kept"),
        (lambda data: data + b"more", "it has more bytes than the index says"),
        (lambda data: data[:-9], "it ended after .* bytes"),
    ],
    ids=["wrong", "longer", "shorter"],
)
def test_a_server_that_sends_other_bytes_than_its_index_says_leaves_no_core(zoo, change, said):
    answer = files(zoo, change=lambda path, data: change(data) if path.endswith("core.safetensors") else data)
    with serving(answer) as url:
        remember(Root(url))
        with pytest.raises(RemoteError, match=said):
            pull(CORE, None, silent)
    assert not list(cache_folder().glob(f"cores/*/{CORE}"))


def test_a_lost_network_is_one_line_and_the_index_is_taken_as_it_was(zoo, caplog):
    with serving(files(zoo)) as url:
        remember(Root(url))
        refresh(roots()[0])
    with pytest.raises(RemoteError, match="is not transferred: ConnectionRefusedError"):
        pull(CORE, None, silent)
    assert "its index is taken as it was" in caplog.text


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda index: index["cores"].update({"../../evil": index["cores"][CORE]}), "not read: "),
        (lambda index: index["cores"][CORE]["files"].update({"../evil": {"sha256": "0" * 64, "size": 1}}), "has the files"),
        (lambda index: index["cores"][CORE]["files"]["card.json"].update(size=2**40), "not read: Expected `int` <= 268435456"),
        (lambda index: index.update(schema=2), "its schema is 2, this transferkit reads up to 1"),
    ],
    ids=["id", "file", "size", "schema"],
)
def test_an_index_that_names_what_it_must_not_is_refused(zoo, change, said):
    index = json.loads((zoo / INDEX).read_bytes())
    change(index)
    content = {name: value for name, value in index.items() if name != "digest"}
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    (zoo / INDEX).write_text(json.dumps({**content, "digest": digest}))
    with pytest.raises(RemoteError, match=said):
        refresh(Root(str(zoo)))


def test_an_index_is_signed_off_by_its_digest(zoo, capsys):
    digest = hashlib.sha256((zoo / INDEX).read_bytes()).hexdigest()
    assert run_json(capsys, "zoo", "add", str(zoo), "--expect", digest)["digest"] == digest
    changed = Index.from_bytes((zoo / INDEX).read_bytes())
    (zoo / INDEX).write_bytes(Index({}, changed.schema).to_bytes())
    with pytest.raises(RemoteError, match=f"and {digest} is expected"):
        refresh(roots()[0])
    assert [row["id"] for row in run_json(capsys, "zoo", "list", "--remote")] == [CORE]
    code, _, said = run(capsys, "zoo", "add", str(zoo), "--expect", "abc")
    assert (code, "--expect='abc' must be 64 hexadecimal digits" in said) == (2, True)


def test_the_commands_from_push_to_remove(full_core_folder, tmp_path, capsys):
    url = str(tmp_path / "zoo")
    assert run_json(capsys, "zoo", "push", str(full_core_folder), url)["id"] == CORE
    assert run_json(capsys, "zoo", "add", url)["cores"] == [CORE]
    assert run_json(capsys, "zoo", "list", "--remote")[0]["zoo"] == url
    assert run(capsys, "zoo", "pull", CORE)[1].startswith(f"{CORE} is in ")
    assert CORE in [row["id"] for row in run_json(capsys, "zoo", "list")]
    assert run_json(capsys, "zoo", "remove", url) == {"url": url}
    assert "none was added" in run(capsys, "zoo", "remove", url)[2]
    assert "unknown core of zoos elsewhere 'nothing-v1'" in run(capsys, "zoo", "pull", "nothing-v1")[2]


@pytest.mark.parametrize("url", ["ftp://host/zoo", "simplecache::http://host", "memory://zoo", "", " "])
def test_other_urls_are_refused(url):
    with pytest.raises(SettingError, match="must be a folder, or start with one of"):
        Transport(url)


def test_a_zoo_in_s3(full_core_folder, monkeypatch):
    import s3fs
    from moto.server import ThreadedMotoServer

    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.setenv(name, "test")
    server = ThreadedMotoServer("127.0.0.1", port=0)
    server.start()
    try:
        host, port = server.get_host_and_port()
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        s3fs.S3FileSystem().mkdir("zoos")
        push(full_core_folder, "s3://zoos/mine")
        remember(Root("s3://zoos/mine"))
        assert load_core(pull(CORE, None, silent)).id == CORE
        with pytest.raises(ArtifactError, match="never rewritten"):
            push(full_core_folder, "s3://zoos/mine")
    finally:
        server.stop()


HUB_SCRIPT = """
import sys, transferkit.cli.main as cli
for line in sys.argv[1:]:
    assert cli.main(line.split()) == 0, line
"""


def hub(stored):
    """Answers as a hub of models does for one repository, `me/zoo`, whose files are `stored`."""

    entry = lambda name: {"type": "file", "oid": "0" * 40, "size": len(stored[name]), "path": name}  # noqa: E731

    def answer(handler, path):  # noqa: PLR0911
        body = handler.rfile.read(int(handler.headers.get("Content-Length") or 0))
        reply = lambda data: send(handler, json.dumps(data).encode(), Content_Type="application/json")  # noqa: E731
        name = path.partition("/resolve/main/")[2].partition("?")[0]
        if name:
            start, end = (int(part) for part in handler.headers.get("Range", "bytes=0-99999999")[6:].split("-"))
            return send(handler, stored[name][start : end + 1], 206)
        if path.endswith("/paths-info/main"):
            return reply([entry(name) for name in json.loads(body)["paths"] if name in stored])
        if "/tree/main" in path:
            folder = path.partition("/tree/main")[2].partition("?")[0].strip("/")
            return reply([entry(name) for name in stored if name.rpartition("/")[0] == folder])
        if path.endswith("/preupload/main"):
            asked = [file["path"] for file in json.loads(body)["files"]]
            return reply({"files": [{"path": name, "uploadMode": "regular", "shouldIgnore": False} for name in asked]})
        if path.partition("?")[0].endswith("/commit/main"):
            lines = map(json.loads, body.splitlines())
            files = [line["value"] for line in lines if line["key"] == "file"]
            stored.update({file["path"]: base64.b64decode(file["content"]) for file in files})
            url = f"http://{handler.headers['Host']}/me/zoo/commit/1"
            return reply({"commitUrl": url, "commitOid": "0" * 40, "hookOutput": ""})
        if path.partition("?")[0] in ("/api/models/me/zoo", "/api/models/me/zoo/revision/main"):
            return reply({"id": "me/zoo", "sha": "0" * 40, "siblings": [], "private": False, "downloads": 0, "tags": []})
        return send(handler, b"", 404)

    return answer


def test_a_zoo_on_a_hub(full_core_folder, tmp_path):
    """In a process of its own, since the hub's library takes the address of the hub when it is imported."""
    stored = {}
    url = "hf://me/zoo"
    with serving(hub(stored)) as address:
        surroundings = os.environ | {"HF_ENDPOINT": address, "HF_TOKEN": "test", "HF_HOME": str(tmp_path)}
        lines = [f"zoo push {full_core_folder} {url}", f"zoo add {url}", f"zoo pull {CORE}"]
        command = [sys.executable, "-c", HUB_SCRIPT, *lines]
        done = subprocess.run(command, env=surroundings, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"{CORE} is in {tmp_path}" in done.stdout
    assert set(stored) == {INDEX, *(f"{CORE}/{name}" for name in (*FILES, "README.md"))}
