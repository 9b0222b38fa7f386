"""Bytes from and to other machines, by fsspec: bounded, checked, resumed, and with one line about whatever fails."""

from __future__ import annotations

import asyncio
import contextlib
import hashlib
import time
from collections.abc import Callable, Iterator
from http import HTTPStatus
from pathlib import Path
from typing import TYPE_CHECKING, Any

from transferkit.errors import ConfigError, RemoteError, SettingError

if TYPE_CHECKING:
    from transferkit.zoo.remote.index import File

PROTOCOLS = ("file", "gs", "hf", "http", "https", "s3")

CHUNK = 2**18
"""Bytes that are read at once."""

CONNECT, SILENCE = 10, 30
"""Seconds to connect, and without a byte."""

LEAST_RATE = 20_000
"""Bytes a second below which a transfer is given up, after a minute."""

Report = Callable[[int, int], None]
"""Is told how many bytes of how many are there."""


class Transport:
    """A folder at a URL."""

    def __init__(self, url: str) -> None:
        """Find out who reads such URLs; nothing is sent yet.

        Raises:
            ConfigError: nobody does, or a package is missing.
        """
        import fsspec  # noqa: PLC0415 - most commands stay on this machine

        self.url, self.protocol = url.rstrip("/"), url.partition("://")[0] if "://" in url else "file"
        if not url.strip() or self.protocol not in PROTOCOLS or "::" in url:
            raise SettingError("url", value=url, allowed=f"a folder, or start with one of {', '.join(PROTOCOLS[1:])} and ://")
        try:
            self.fs, self.root = fsspec.core.url_to_fs(self.url, **self._options())
        except ImportError as error:
            raise ConfigError(
                f"{self.protocol}:// needs packages that are not installed ({error})",
                remedy="pip install 'transferkit[remote]'",
            ) from None
        except Exception as error:  # of any of its implementations
            raise RemoteError(f"{url} cannot be used: {_reason(error)}") from None

    @property
    def writable(self) -> bool:
        """Whether anything can be written there."""
        return self.protocol not in ("http", "https")

    def read(self, name: str, most: int) -> bytes | None:
        """Read a file of at most so many bytes; None if there is none.

        Raises:
            RemoteError: it cannot be read, or is larger.
        """
        data = bytearray()
        with self._said(name):
            try:
                with self._open(name, whole=True) as source:
                    for chunk in _chunks(source, most + 1):
                        data += chunk
            except FileNotFoundError as error:
                if _is_missing(_cause(error)):
                    return None
                raise
        if len(data) > most:
            raise RemoteError(f"{self._path(name)} has more than {most:,} bytes, which are not read")
        return bytes(data)

    def download(self, name: str, file: File, part: Path, report: Report) -> None:
        """Fetch a file into `part`, from where an earlier call broke off, and check its bytes.

        Raises:
            RemoteError: it cannot be read, or is not what the index says.
        """
        with self._said(name, part):
            self._continue(name, file, part, report)
        if hashlib.sha256(part.read_bytes()).hexdigest() != file.sha256:
            part.unlink()
            raise RemoteError(f"{self._path(name)} has other bytes than the zoo's index says, and is not kept")

    def write(self, name: str, data: bytes) -> None:
        """Write a file, in place of one that is there.

        Raises:
            RemoteError: it cannot be written.
        """
        path = f"{self.root}/{name}"
        with self._said(name):
            if self.protocol == "file":
                self.fs.makedirs(path.rpartition("/")[0], exist_ok=True)
            self.fs.pipe_file(path, data)

    def _continue(self, name: str, file: File, part: Path, report: Report) -> None:
        done = part.stat().st_size if part.exists() else 0
        if done == file.size:
            return
        with part.open("r+b" if done else "wb") as out, contextlib.ExitStack() as stack:
            source, done = self._open_at(done if done < file.size else 0, name, stack)
            out.seek(done)
            for chunk in _chunks(source, file.size + 1 - done):
                out.write(chunk)
                done += len(chunk)
                report(min(done, file.size), file.size)
            out.truncate(done if done <= file.size else 0)
        if done != file.size:
            raise EOFError(
                f"it ended after {done:,} of {file.size:,} bytes"
                if done < file.size
                else "it has more bytes than the index says"
            )

    def _open_at(self, start: int, name: str, stack: contextlib.ExitStack) -> tuple[Any, int]:
        """Open a file in its middle; where that cannot be, at its beginning."""
        if start:
            with contextlib.suppress(Exception):
                source = stack.enter_context(self._open(name, whole=False))
                source.seek(start)
                source.read(1)  # only now anything is asked for
                source.seek(start)
                return source, start
        return stack.enter_context(self._open(name, whole=True)), 0

    def _open(self, name: str, *, whole: bool) -> Any:  # noqa: ANN401 - a file of fsspec
        """Open a file to read all of it in one stream, or from somewhere in its middle."""
        options = {} if self.protocol not in ("http", "https") else {"block_size": 0} if whole else {"block_size": CHUNK}
        return self.fs.open(f"{self.root}/{name}", "rb", **options)

    def _options(self) -> dict[str, Any]:
        """Time limits, and no listing that was kept from before."""
        if self.protocol in ("http", "https"):
            import aiohttp  # noqa: PLC0415

            limits = aiohttp.ClientTimeout(total=None, sock_connect=CONNECT, sock_read=SILENCE)
            return {"use_listings_cache": False, "skip_instance_cache": True, "client_kwargs": {"timeout": limits}}
        if self.protocol == "s3":
            limits = {"connect_timeout": CONNECT, "read_timeout": SILENCE, "retries": {"max_attempts": 2}}
            return {"use_listings_cache": False, "skip_instance_cache": True, "config_kwargs": limits}
        return {} if self.protocol == "file" else {"use_listings_cache": False, "skip_instance_cache": True}

    @contextlib.contextmanager
    def _said(self, name: str, part: Path | None = None) -> Iterator[None]:
        """Put whatever fails between machines into one line."""
        try:
            yield
        except Exception as error:  # of any of fsspec's implementations and of what they use
            kept = part is not None and part.exists() and part.stat().st_size > 0
            again = "; what arrived is kept, and the same command goes on" if kept else ""
            raise RemoteError(f"{self._path(name)} is not transferred: {_reason(error)}{again}") from None

    def _path(self, name: str) -> str:
        return f"{self.url}/{name}"


def _chunks(source: Any, most: int) -> Iterator[bytes]:  # noqa: ANN401 - a file of fsspec
    """Read at most so many bytes, not slower than a drip."""
    started, done = time.monotonic(), 0
    while done < most and (chunk := source.read(min(CHUNK, most - done))):
        yield chunk
        done += len(chunk)
        passed = time.monotonic() - started
        if passed > 60 + done / LEAST_RATE:
            raise TimeoutError(f"only {done:,} bytes came in {passed:.0f} s")


def _cause(error: BaseException) -> BaseException:
    """What an error comes from: fsspec takes whatever a server answers for a file that is not there."""
    return error if error.__cause__ is None else _cause(error.__cause__)


def _is_missing(cause: BaseException) -> bool:
    return isinstance(cause, FileNotFoundError) or getattr(cause, "status", None) == HTTPStatus.NOT_FOUND


def _reason(error: BaseException) -> str:
    error = _cause(error)
    if _is_missing(error):
        return "it does not exist"
    if isinstance(error, asyncio.TimeoutError | TimeoutError) and not str(error):
        return f"no answer within {SILENCE} s"
    text = " ".join(str(error).split())[:200]
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
