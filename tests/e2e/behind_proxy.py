#!/usr/bin/env python3
"""Runs the shipped configuration of a proxy in front of a real cellmapd with a throwaway certificate, and checks what a
proxy could spoil: tokens, request ids, events, uploads of any size, and the command line over HTTPS.

Usage: behind_proxy.py nginx|haproxy CELLMAP CELLMAPD CONFIGURATION      exit code 77: the proxy is not installed
"""
import http.client
import json
import os
import re
import shutil
import socket
import ssl
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def certificate(folder):
    cert, key = folder / "cert.pem", folder / "key.pem"
    subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes",
                    "-days", "1", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost",
                    "-keyout", key, "-out", cert], check=True, capture_output=True)
    (folder / "both.pem").write_text(cert.read_text() + key.read_text())
    return cert, key


def nginx_command(text, folder, port, backend, cert, key):
    """The shipped part inside the least of a main configuration."""
    text = text.replace("127.0.0.1:8080", backend).replace("listen [::]:443 ssl http2;", "")
    text = text.replace("443 ssl", f"127.0.0.1:{port} ssl").replace("maps.example.org;", "localhost;")
    text = re.sub(r"ssl_certificate +\S+;", f"ssl_certificate {cert};", text)
    text = re.sub(r"ssl_certificate_key +\S+;", f"ssl_certificate_key {key};", text)
    paths = "".join(f"{name}_temp_path {folder}/{name};" for name in
                    ("client_body", "proxy", "fastcgi", "uwsgi", "scgi"))
    (folder / "nginx.conf").write_text(
        f"daemon off; master_process off; pid {folder}/pid; error_log {folder}/error.log;\n"
        f"events {{}}\nhttp {{ access_log off; {paths}\n{text}\n}}\n")
    return ["nginx", "-p", str(folder), "-c", str(folder / "nginx.conf"), "-e", str(folder / "error.log")]


def haproxy_command(text, folder, port, backend, cert, key):
    del cert, key
    text = text.replace("127.0.0.1:8080", backend).replace("bind :443", f"bind 127.0.0.1:{port}")
    text = re.sub(r"crt \S+", f"crt {folder}/both.pem", text).replace("log /dev/log local0\n", "")
    text = text.replace("    log global\n", "")
    (folder / "haproxy.cfg").write_text(text)
    return ["haproxy", "-db", "-f", str(folder / "haproxy.cfg")]


class Checks:
    def __init__(self, port, cert, token):
        self.port, self.token = port, token
        self.context = ssl.create_default_context(cafile=cert)
        self.failures = []

    def check(self, holds, rule, found=""):
        print(("holds   " if holds else "FAILS   ") + rule + ("" if holds else f": {found}"))
        if not holds:
            self.failures.append(rule)

    def connect(self):
        return http.client.HTTPSConnection("localhost", self.port, context=self.context, timeout=20)

    def ask(self, method, path, body=None, **headers):
        headers = {name.replace("_", "-"): value for name, value in headers.items()}
        headers.setdefault("Authorization", f"Bearer {self.token}")
        connection = self.connect()
        connection.request(method, path, body, headers)
        response = connection.getresponse()
        return response, response.read()

    def plain_requests(self):
        response, body = self.ask("GET", "/v1/maps")
        self.check(response.status == 200 and json.loads(body) == {"maps": []}, "a token passes", response.status)
        self.check("max-age" in response.headers.get("Strict-Transport-Security", ""), "browsers are told to stay on TLS")
        response, _ = self.ask("GET", "/v1/maps", Authorization="Bearer wrong")
        self.check(response.status == 401 and "WWW-Authenticate" in response.headers, "a wrong token is refused")
        response, _ = self.ask("GET", "/v1/maps", X_Request_Id="from-the-client.1")
        self.check(response.headers["X-Request-Id"] == "from-the-client.1", "the client's request id goes through",
                   response.headers["X-Request-Id"])
        response, body = self.ask("POST", "/v1/maps/town/places:search", b"", Content_Type="application/vnd.cellmap.place-query")
        self.check(response.status == 404 and json.loads(body)["detail"] == "Servers ask this of each other.",
                   "what servers ask each other is not for clients", (response.status, body))
        response, body = self.ask("GET", "/v1/maps/atlantis")
        made = response.headers["X-Request-Id"]
        self.check(re.fullmatch("[0-9a-f-]{32,36}", made) and json.loads(body)["request_id"] == made,
                   "the proxy's request id reaches the server", made)

    def uploads(self):
        size = 48 << 20
        response, body = self.ask("PUT", "/v1/maps/big/archive", b"\0" * size,
                                  Content_Type="application/vnd.cellmap.archive")
        self.check(response.status == 422, "48 MB arrive whole and are judged by cellmapd", (response.status, body))

        def pieces():
            for _ in range(size >> 20):
                yield b"\0" * (1 << 20)
        response, body = self.ask("PUT", "/v1/maps/big/archive", pieces(),
                                  Content_Type="application/vnd.cellmap.archive")
        self.check(response.status == 422, "so do they in chunks", (response.status, body))

    def events(self):
        self.ask("POST", "/v1/maps", json.dumps({"name": "town"}), Content_Type="application/json")
        connection = self.connect()
        start = time.monotonic()
        connection.request("GET", "/v1/maps/town/events", headers={"Authorization": f"Bearer {self.token}"})
        stream = connection.getresponse()
        first = stream.readline()
        took = time.monotonic() - start
        self.check(stream.status == 200 and first.strip() and took < 3, "an event comes at once", (first, took))
        # The server's sign of life, every 5 s: held back by who collects 4 or 16 kB first.
        while stream.readline().strip():
            pass
        start = time.monotonic()
        sign = stream.readline()
        took = time.monotonic() - start
        self.check(sign.startswith(b":") and took < 8, "and so does a sign of life", (sign, took))
        connection.close()

    def command_line(self, cellmap, cert):
        environment = dict(os.environ, CELLMAP_TOKEN=self.token, SSL_CERT_FILE=str(cert))
        told = subprocess.run([cellmap, "maps", "--server", f"https://localhost:{self.port}", "--json"],
                              env=environment, capture_output=True, text=True, check=False)
        self.check(told.returncode == 0 and '"town"' in told.stdout, "the command line speaks HTTPS with its token",
                   told.stdout + told.stderr)


def wait_for(port, process):
    for _ in range(200):
        if process.poll() is not None:
            sys.exit(f"the proxy ended with {process.returncode}")
        try:
            socket.create_connection(("127.0.0.1", port), 1).close()
            return
        except OSError:
            time.sleep(0.05)
    sys.exit("the proxy does not listen")


def run(kind, cellmap, cellmapd, configuration, folder):
    cert, key = certificate(folder)
    tokens = folder / "tokens"
    made = subprocess.run([cellmap, "token", "create", "test", "--tokens", tokens, "--scope", "admin"],
                          check=True, capture_output=True, text=True)
    port = free_port()
    processes = []
    try:
        server = subprocess.Popen([cellmapd, "--store", folder / "map.db", "--listen", "127.0.0.1:0", "--tokens", tokens],
                                  stdout=subprocess.PIPE, text=True)
        processes.append(server)
        backend = re.search(r"http://(\S+)", server.stdout.readline()).group(1)
        command = {"nginx": nginx_command, "haproxy": haproxy_command}[kind]
        proxy = subprocess.Popen(command(Path(configuration).read_text(), folder, port, backend, cert, key))
        processes.append(proxy)
        wait_for(port, proxy)
        time.sleep(0.5 if kind == "nginx" else 2.5)  # until HAProxy has seen that the server is ready
        checks = Checks(port, cert, made.stdout.strip())
        checks.plain_requests()
        checks.uploads()
        checks.events()
        checks.command_line(cellmap, cert)
        return 1 if checks.failures else 0
    finally:
        for process in reversed(processes):
            process.terminate()
            process.wait()


def main():
    kind, cellmap, cellmapd, configuration = sys.argv[1:]
    os.environ["PATH"] += ":/usr/sbin:/sbin"
    if not shutil.which(kind):
        print(f"{kind} is not installed: ./install-dependencies.sh --with-proxies")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        return run(kind, cellmap, cellmapd, configuration, Path(folder))


if __name__ == "__main__":
    sys.exit(main())
