"""Bytes that are read in pieces: a file, or a resource of any web server that answers ranges."""

from pathlib import Path
from typing import BinaryIO, Protocol
from urllib.parse import urlsplit

from .errors import Error, corrupt
from .transport import Transport


class ByteSource(Protocol):
    """``size`` is known after the first read."""

    name: str
    size: int

    def read(self, offset: int, length: int) -> bytes:
        """At most ``length`` bytes from ``offset`` on: fewer only at the end."""

    def forget(self) -> None:
        """The next read is a first one again."""

    def close(self) -> None: ...


class FileSource:
    def __init__(self, path: str | Path) -> None:
        self.name = str(path)
        try:
            self._file: BinaryIO = open(path, "rb")
            self.size = self._file.seek(0, 2)
        except OSError as error:
            raise Error("not-found" if isinstance(error, FileNotFoundError) else "io",
                        f"{path} cannot be read: {error.strerror}.") from None

    def read(self, offset: int, length: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(length)

    def forget(self) -> None:
        self.size = self._file.seek(0, 2)

    def close(self) -> None:
        self._file.close()


class HttpSource:
    """By Range, with If-Match on every read but the first. Error("precondition-failed") where the resource was
    replaced between two reads. Servers without ranges send all, once."""

    def __init__(self, url: str, token: str | None = None, timeout_s: float = 30.0) -> None:
        parts = urlsplit(url)
        self.name = url
        self.size = 0
        self._path = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        self._transport = Transport(f"{parts.scheme}://{parts.netloc}", token, timeout_s)
        self._etag: str | None = None
        self._whole: bytes | None = None

    def read(self, offset: int, length: int) -> bytes:
        if length <= 0:
            return b""
        if self._whole is not None:
            return self._whole[offset:offset + length]
        headers = {"Range": f"bytes={offset}-{offset + length - 1}"}
        # A weak tag never matches If-Match (RFC 9110, 13.1.1).
        if self._etag and not self._etag.startswith("W/"):
            headers["If-Match"] = self._etag
        answer = self._transport.request("GET", self._path, headers=headers)
        self._etag = self._etag or answer.header("etag")
        if answer.status == 200:
            self._whole, self.size = answer.body, len(answer.body)
            return self._whole[offset:offset + length]
        total = answer.header("content-range").rpartition("/")[2]
        if not total.isdigit():
            raise corrupt(f"{self.name} answers ranges without saying how long it is.")
        if self.size not in (0, int(total)):
            raise Error("precondition-failed", f"{self.name} changed its length while it was read.")
        self.size = int(total)
        return answer.body

    def forget(self) -> None:
        self.size, self._etag, self._whole = 0, None, None

    def close(self) -> None:
        self._transport.close()
