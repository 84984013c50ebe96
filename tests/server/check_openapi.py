#!/usr/bin/env python3
"""Holds what the server answers in its tests against schema/openapi.yaml.

Runs the API's tests with a recording of every request and response, then checks that each answered route, status and
content type is documented, that each JSON body follows its schema (accepted requests too), and that every documented
status was seen or is in the short list of those that tests cannot provoke.
Usage: check_openapi.py SERVER_TEST OPENAPI_YAML
"""
import json
import os
import re
import subprocess
import sys
import tempfile

import jsonschema
import yaml

# Documented, but not provoked: a store that fails or is full, and refusals that every operation of a kind shares.
UNSEEN_STATUSES = {"406", "413", "429", "503", "507"}


def record(server_test):
    """All exchanges of the API's tests."""
    with tempfile.NamedTemporaryFile(suffix=".jsonl") as file:
        # A test that fails is another test's business.
        environment = dict(os.environ, CELLMAP_RECORD=file.name)
        subprocess.run([server_test, "--gtest_filter=Api*", "--gtest_brief=1"], env=environment, check=False)
        return [json.loads(line) for line in file.read().decode().splitlines()]


class Checker:
    def __init__(self, document):
        self.document = document
        self.errors = set()
        self.seen = set()
        self.paths = []
        for template, item in document["paths"].items():
            pattern = re.sub(r"\\{\w+\\}", "[^/]+", re.escape(template))
            self.paths.append((re.compile(pattern + "$"), template, item))
        # Literal paths before parameters, as "cells:batch" is no map.
        self.paths.sort(key=lambda path: path[1].count("{"))

    def resolve(self, node):
        while "$ref" in node:
            target = self.document
            for part in node["$ref"][2:].split("/"):
                target = target[part]
            node = target
        return node

    def validate(self, body, schema, where):
        resolver = jsonschema.RefResolver("", self.document)
        validator = jsonschema.Draft202012Validator(schema, resolver=resolver)
        for error in validator.iter_errors(body):
            self.errors.add(f"{where}: {error.message[:200]} at {'/'.join(map(str, error.absolute_path))}")

    def find(self, target):
        path = target.split("?")[0]
        for pattern, template, item in self.paths:
            if pattern.match(path):
                return template, item
        return None, None

    def check(self, exchange):
        method, status = exchange["method"].lower(), str(exchange["status"])
        template, item = self.find(exchange["target"])
        where = f"{exchange['method']} {template or exchange['target']} {status}"
        if template is None:
            if status != "404" and exchange["status"] != 400:
                self.errors.add(f"{where}: a path that is not documented")
            return
        operation = item.get(method) or (item.get("get") if method == "head" else None)
        if operation is None:
            if status != "405" or "Allow" not in exchange["headers"]:
                self.errors.add(f"{where}: a method that is not documented")
            return
        response = operation["responses"].get(status)
        if response is None:
            # Broken escapes in the target are refused before there is an operation.
            if not (status == "400" and "%zz" in exchange["target"]):
                self.errors.add(f"{where}: a status that is not documented")
            return
        self.seen.add((template, method, status))
        self.check_security(exchange, operation, where)
        self.check_body(exchange, self.resolve(response), where)
        self.check_request(exchange, operation, where)

    def check_security(self, exchange, operation, where):
        """What the server asks for is what is documented."""
        documented = operation["security"]
        scopes = documented[0]["token"] if documented else []
        challenge = exchange["headers"].get("WWW-Authenticate", "")
        asked = re.search(r'scope="([^"]*)"', challenge)
        if exchange["status"] in (401, 403) and (not documented or not challenge.startswith("Bearer ")):
            self.errors.add(f"{where}: refused, though everybody may, or without a challenge")
        elif asked and [asked.group(1)] != scopes:
            self.errors.add(f"{where}: asks for {asked.group(1)}, documented are {scopes}")

    def check_body(self, exchange, response, where):
        documented = response.get("content", {})
        content_type = exchange["headers"].get("Content-Type", "").split(";")[0]
        if exchange["status"] in (204, 304, 308):
            return
        if content_type not in documented:
            self.errors.add(f"{where}: Content-Type '{content_type}' is not documented")
        elif "body" in exchange and exchange["method"] != "HEAD":
            self.validate(json.loads(exchange["body"]), documented[content_type]["schema"], where)

    def check_request(self, exchange, operation, where):
        if exchange["status"] >= 300 or "request_body" not in exchange or not exchange["request_body"]:
            return
        schema = operation["requestBody"]["content"]["application/json"]["schema"]
        self.validate(json.loads(exchange["request_body"]), schema, where + " (request)")

    def unseen(self):
        for template, item in self.document["paths"].items():
            for method, operation in item.items():
                if method == "parameters":
                    continue
                for status in operation["responses"]:
                    if status not in UNSEEN_STATUSES and (template, method, status) not in self.seen:
                        yield f"{method.upper()} {template} {status}"


def main():
    server_test, openapi = sys.argv[1:]
    with open(openapi, encoding="utf-8") as file:
        checker = Checker(yaml.safe_load(file))
    exchanges = record(server_test)
    for exchange in exchanges:
        checker.check(exchange)
    for error in sorted(checker.errors):
        print("WRONG   ", error)
    unseen = sorted(checker.unseen())
    for name in unseen:
        print("UNSEEN  ", name)
    print(f"{len(exchanges)} exchanges, {len(checker.seen)} documented answers seen")
    return 1 if checker.errors or unseen or not exchanges else 0


if __name__ == "__main__":
    sys.exit(main())
