"""A cellmapd that can be killed, and HTTP to it."""
import http.client
import json
import random
import signal
import socket
import subprocess
import time
from pathlib import Path


class Lost(Exception):
    """No whole answer came: what was asked may have happened or not."""


class Refused(Exception):
    """An answer with a status of 400 and more."""

    def __init__(self, status, body):
        super().__init__(f"{status}: {body[:300]!r}")
        self.status, self.body = status, body

    @property
    def code(self):
        """Of a problem document; else None."""
        try:
            return json.loads(self.body).get("code")
        except ValueError:
            return None


class Api:
    """One request a connection, from any thread."""

    def __init__(self, port, host="127.0.0.1"):
        self.port, self.host = port, host

    def call(self, method, path, body=None, media_type=None, accept="*/*"):
        """The body of the answer. Raises Lost and Refused."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=60)
        try:
            headers = {"Accept": accept}
            if media_type:
                headers["Content-Type"] = media_type
            connection.request(method, path, body, headers)
            answer = connection.getresponse()
            data = answer.read()
        except (OSError, http.client.HTTPException) as error:
            raise Lost(str(error)) from error
        finally:
            connection.close()
        if answer.status >= 400:
            raise Refused(answer.status, data)
        return data

    def get(self, path):
        return json.loads(self.call("GET", path, accept="application/json"))

    def send(self, method, path, document=None):
        body = None if document is None else json.dumps(document)
        data = self.call(method, path, body, "application/json" if body else None)
        return json.loads(data) if data else None


def free_port():
    """Below those that the kernel gives to connections that go out, so that none takes it before a server listens there."""
    while True:
        port = random.randrange(10_000, 32_000)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
                return port
            except OSError:
                pass


class Server:
    """Always on the same port and store, so that clients find it again. `store`: a file, or an address together with `log`."""

    def __init__(self, program, store, data_root, *options, log=None):
        self.port = free_port()
        self.api = Api(self.port)
        self.store = store
        self.log = open(log or f"{store}.log", "ab")
        self.command = [program, "--store", str(store), "--listen", f"127.0.0.1:{self.port}", "--threads", "1",
                        "--data-root", str(data_root), *options]
        self.process = None

    def spawn(self):
        self.process = subprocess.Popen(self.command, stdout=subprocess.DEVNULL, stderr=self.log)

    def start(self):
        """Returns once it answers; raises RuntimeError where it does not."""
        if not self.process or self.process.poll() is not None:
            self.spawn()
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline:
            if self.process.poll() is not None:
                said = "".join(Path(self.log.name).read_text(errors="replace").splitlines(keepends=True)[-5:])
                raise RuntimeError(f"cellmapd ended with {self.process.returncode}: {said}")
            try:
                self.api.call("GET", "/readyz")
                return
            except (Lost, Refused):
                time.sleep(0.01)
        raise RuntimeError("cellmapd did not answer within a minute")

    def end(self, how):
        if self.process:
            self.process.send_signal(how)
            self.process.wait()

    def kill(self):
        self.end(signal.SIGKILL)

    def stop(self):
        self.end(signal.SIGTERM)
