"""HTTP/1.1 with one kept connection, bearer tokens, and errors as Error."""

import http.client
import json
import socket
import ssl
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import BinaryIO
from urllib.parse import urlsplit

from .errors import Error, invalid
from .wire import decompressed

MAX_ANSWER_BYTES = 1 << 30
#: Where a server says nothing of its own, by status.
_CODES = {400: "invalid-argument", 401: "unauthenticated", 403: "permission-denied", 404: "not-found", 409: "conflict",
          412: "precondition-failed", 413: "too-large", 415: "unsupported", 416: "range-not-satisfiable",
          429: "rate-limited", 502: "unavailable", 503: "unavailable", 504: "unavailable", 507: "disk-full"}


@dataclass(frozen=True)
class Answer:
    status: int
    headers: Mapping[str, str]  #: names in lower case
    body: bytes = field(repr=False)

    def header(self, name: str) -> str:
        return self.headers.get(name, "")

    def json(self) -> dict[str, object]:
        try:
            document = json.loads(self.body)
        except ValueError:
            document = None
        if not isinstance(document, dict):
            raise Error("corrupt-data", "The server's answer is no JSON object; is this a CELLmap server?")
        return document


class Transport:
    """Thread-safe: requests of several threads go one after another. ``follow`` has connections of its own."""

    def __init__(self, url: str, token: str | None, timeout_s: float) -> None:
        parts = urlsplit(url if "://" in url else f"http://{url}")
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise invalid(f"Expected the address of a server such as http://127.0.0.1:8080, found {url!r}.")
        if token is not None and (not token or not token.isascii() or not token.isprintable() or " " in token):
            raise invalid("A token is one word of ASCII characters.")
        self._https, self._host, self._port = parts.scheme == "https", parts.hostname, parts.port
        self._prefix, self._token, self._timeout_s = parts.path.rstrip("/"), token, timeout_s
        self.url = f"{parts.scheme}://{parts.netloc}{self._prefix}"
        self._lock = threading.Lock()
        self._kept: http.client.HTTPConnection | None = None

    def request(self, method: str, path: str, body: bytes | BinaryIO | None = None,
                headers: Mapping[str, str] | None = None, timeout_s: float | None = None) -> Answer:
        """The answer; Error where it is none of 2xx and 304. Tries once more where a kept connection was closed."""
        with self._lock:
            fresh = self._kept is None
            try:
                answer = self._once(method, path, body, headers, timeout_s)
            except (ConnectionResetError, BrokenPipeError, http.client.RemoteDisconnected) as error:
                self._drop()
                if fresh:
                    raise self._lost(error, method, path) from None
                try:
                    if body is not None and not isinstance(body, bytes):
                        body.seek(0)
                    answer = self._once(method, path, body, headers, timeout_s)
                except (OSError, http.client.HTTPException) as again:
                    self._drop()
                    raise self._lost(again, method, path) from None
            except (OSError, http.client.HTTPException) as error:
                self._drop()
                raise self._lost(error, method, path) from None
        if answer.status >= 300 and answer.status != 304:
            raise _problem(answer)
        return answer

    def follow(self, path: str) -> Iterator[tuple[str, str]]:
        """(event, data) of a stream of server-sent events until it ends. Close the iterator to stop early."""
        connection = self._connect(None)
        try:
            connection.request("GET", self._prefix + path, headers=self._headers({"Accept": "text/event-stream"}))
            response = connection.getresponse()
            if response.status != 200:
                raise _problem(_read(response))
            event = "message"
            data: list[str] = []
            for raw in response:
                line = raw.decode("utf-8", "replace").rstrip("\r\n")
                name, _, value = line.partition(":")
                if line == "" and data:
                    yield event, "\n".join(data)
                if line == "":
                    event, data = "message", []
                elif name == "event":
                    event = value.removeprefix(" ")
                elif name == "data":
                    data.append(value.removeprefix(" "))
        except (OSError, http.client.HTTPException) as error:
            raise self._lost(error, "GET", path) from None
        finally:
            connection.close()

    def download(self, path: str, to: BinaryIO, timeout_s: float) -> None:
        """Writes an answer of any length to a file; over a connection of its own."""
        connection = self._connect(timeout_s)
        try:
            connection.request("GET", self._prefix + path, headers=self._headers(None))
            response = connection.getresponse()
            if response.status != 200:
                raise _problem(_read(response))
            while part := response.read(1 << 20):
                to.write(part)
        except (OSError, http.client.HTTPException) as error:
            raise self._lost(error, "GET", path) from None
        finally:
            connection.close()

    def close(self) -> None:
        with self._lock:
            self._drop()

    def _connect(self, timeout_s: float | None) -> http.client.HTTPConnection:
        # A comment comes every few seconds of silence, so events need no other limit.
        limit = timeout_s or self._timeout_s
        if self._https:
            return http.client.HTTPSConnection(self._host, self._port, timeout=limit, context=ssl.create_default_context())
        return http.client.HTTPConnection(self._host, self._port, timeout=limit)

    def _headers(self, more: Mapping[str, str] | None) -> dict[str, str]:
        headers = {"User-Agent": "cellmap-python/0.1", **(more or {})}
        if self._token is not None:
            headers["Authorization"] = f"Bearer {self._token}"
        return headers

    def _once(self, method: str, path: str, body: bytes | BinaryIO | None, headers: Mapping[str, str] | None,
              timeout_s: float | None) -> Answer:
        if self._kept is None:
            self._kept = self._connect(None)
            self._kept.connect()
            self._kept.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._kept.sock.settimeout(timeout_s or self._timeout_s)
        self._kept.request(method, self._prefix + path, body, self._headers(headers))
        answer = _read(self._kept.getresponse())
        if self._kept.sock is None or answer.header("connection").lower() == "close":
            self._drop()
        return answer

    def _drop(self) -> None:
        if self._kept is not None:
            self._kept.close()
            self._kept = None

    def _lost(self, error: Exception, method: str, path: str) -> Error:
        if isinstance(error, (ConnectionRefusedError, socket.gaierror)):
            return Error("unavailable", f"Nothing accepts connections at {self.url}; check the address and that the "
                                        "server runs.")
        return Error("unavailable", f"The connection to {self.url} broke during {method} {path} ({error!r}).")


def _read(response: http.client.HTTPResponse) -> Answer:
    body = response.read(MAX_ANSWER_BYTES + 1)
    if len(body) > MAX_ANSWER_BYTES:
        raise Error("too-large", f"The server's answer has more than {MAX_ANSWER_BYTES} bytes.")
    headers = {name.lower(): value for name, value in response.getheaders()}
    if headers.get("content-encoding") == "zstd":
        body = decompressed(body, MAX_ANSWER_BYTES, "server's answer")
    return Answer(response.status, headers, body)


def _problem(answer: Answer) -> Error:
    """The server's problem document (RFC 9457), or the status where another server answered."""
    code, detail = _CODES.get(answer.status, "internal"), f"The server answered with {answer.status}."
    try:
        document = json.loads(answer.body)
        code, detail = str(document["code"]), str(document["detail"])
    except (ValueError, KeyError, TypeError):
        pass
    return Error(code, detail, answer.status)
