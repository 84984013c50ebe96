"""A link of 50 ms to the database, then one on which nothing passes any more. Slow: all answers are right, readiness stays green,
CELLs that are asked for by number and hash come from memory as fast as ever, those by number after one question to the database. Hanging: every request ends within its deadline
with 503, readiness turns red, and when the link is back all goes on without a restart."""
import threading
import time
import urllib.request

from database import Cluster
from link import Link
from support import Server, World, note, percentile, timed, wait_until
from uploader import Uploader, count_of, lost
from writers import CELL, content

DELAY_S = 0.025  # each way
DEADLINE_S = 20  # of any request while the database hangs


def fetch_times(world, by_hash, count):
    """Milliseconds of each fetch; raises where the bytes are others."""
    times, cells = [], sorted(world.cells)[:4]
    for i in range(count):
        cell = cells[i % len(cells)]
        digest, path = world.cells[cell]
        url = f"http://127.0.0.1:{world.server.port}/v1/maps/town/cells/{cell}" + (f"?hash={digest}" if by_hash else "")
        begun = time.perf_counter()
        with urllib.request.urlopen(urllib.request.Request(url, headers={"Accept": CELL})) as answer:
            data = answer.read()
        times.append((time.perf_counter() - begun) * 1e3)
        if data != open(path, "rb").read():
            raise RuntimeError(f"CELL {cell} came with other bytes")
    return times


def asked(api):
    """A request of each kind, all at once: {what: (what came of it, seconds)}."""
    told = {}
    requests = {"readyz": lambda: api.call("GET", "/readyz"), "info": lambda: api.get("/v1/maps/town"),
                "cells": lambda: api.get("/v1/maps/town/cells?near=0,0,0&radius=50"),
                "changes": lambda: api.get("/v1/maps/town/changes?since=0"),
                "fetch": lambda: api.call("GET", "/v1/maps/town/cells/1", accept=CELL),
                "create": lambda: api.send("POST", "/v1/maps", {"name": f"made-{time.monotonic_ns()}"})}
    threads = [threading.Thread(target=lambda what=what, act=act: told.update({what: timed(act)})) for what, act in requests.items()]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return told


def while_slow(options, world, link):
    count = 40 if options.short else 200
    row = {"alone_ms": {}, "slow_ms": {}}
    for when in ("alone", "slow"):
        if when == "slow":
            link.order("delay", DELAY_S)
        for what, by_hash, times in (("by_hash", True, count), ("by_id", False, count // 4)):
            row[f"{when}_ms"][what] = round(percentile(fetch_times(world, by_hash, times), 0.5), 2)
    row["requests"] = asked(world.api)
    wrong = [f"with a slow database {what} was told {told}" for what, (told, _) in row["requests"].items() if told != "answered"]
    if row["slow_ms"]["by_hash"] > 3 * row["alone_ms"]["by_hash"] + 1:
        wrong.append(f"hot CELLs take {row['slow_ms']['by_hash']} ms with a slow database, {row['alone_ms']['by_hash']} alone")
    row["roundtrips_by_id"] = round((row["slow_ms"]["by_id"] - row["alone_ms"]["by_id"]) / (2e3 * DELAY_S), 2)
    if row["roundtrips_by_id"] >= 2:
        wrong.append(f"a hot CELL by number takes {row['roundtrips_by_id']} roundtrips to the database, must 1")
    note(f"slow-database, 50 ms a roundtrip: hot CELLs by hash {row['slow_ms']['by_hash']} ms (alone {row['alone_ms']['by_hash']}), by number "
         f"{row['slow_ms']['by_id']} ({row['alone_ms']['by_id']}), {row['roundtrips_by_id']} roundtrips (must below 2); others "
         f"{ {what: seconds for what, (_, seconds) in row['requests'].items()} } s, all right")
    return row, wrong


def while_hanging(world, link, robot, before):
    link.order("hang")
    hung = time.monotonic()
    rounds = [asked(world.api), asked(world.api)]
    red = timed(lambda: world.api.call("GET", "/readyz"))
    sent = count_of([robot])
    link.order("mend")
    wait_until(lambda: world.api.call("GET", "/readyz"), 30, "the server is ready again")
    wait_until(lambda: count_of([robot]) > sent, 30, "a robot goes on")
    again = asked(world.api)
    wrong = [f"with a hanging database {what} was told {told} after {seconds} s" for told_of in rounds
             for what, (told, seconds) in told_of.items() if told != "503 unavailable" or seconds > DEADLINE_S]
    wrong += [f"afterwards {what} was told {told}" for what, (told, _) in again.items() if told != "answered"]
    if red[0] != "503 unavailable":
        wrong.append(f"readiness of a server without a database: {red}")
    if content(world.api, "town") != before:
        wrong.append("the map is another one now")
    longest = max(seconds for told_of in rounds for _, seconds in told_of.values())
    note(f"slow-database, hanging {time.monotonic() - hung:.0f} s: every request ended with 503 within {longest} s (must {DEADLINE_S}), "
         f"readiness red after {red[1]} s, and all went on")
    return {"first": rounds[0], "second": rounds[1], "readiness": red, "longest_s": longest, "afterwards": again}, wrong


def run(options, folder):
    database = Cluster().create()
    link = server = None
    try:
        link = Link(database)
        server = Server(options.cellmapd, link.address, folder / "data", log=folder / "server.log")
        world = World(options, folder, server)
        before = content(world.api, "town")
        slow, wrong = while_slow(options, world, link)
        link.order("mend")
        robot = Uploader("robot", [world.api], world)
        robot.start()
        hanging, also = while_hanging(world, link, robot, before)
        robot.stop()
        return {"slow": slow, "hanging": hanging, "acknowledged": count_of([robot]), "wrong": wrong + also + list(lost(world.api, [robot]))}
    finally:
        if server:
            server.kill()
        if link:
            link.end()
        database.remove()
