"""Two servers, one of which lies behind a link of its own (a network namespace): the link loses everything for a while, so that
neither end is told that the other is gone. The cut off server refuses with a documented code within its deadline; the other one
goes on; no acknowledged write is lost; after healing all goes on without a restart."""
import os
import subprocess
import time

from database import Cluster
from rows.slow_database import DEADLINE_S, asked
from support import Api, Server, World, note, wait_until
from uploader import Uploader, count_of, longest_silence_s, lost

DATABASE, NEAR, FAR = "10.211.77.1", "10.211.78.1", "10.211.78.2"  # FAR: where the server's HTTP is


def ip(*words):
    subprocess.run(["ip", *words], check=True, capture_output=True)


class Namespace:
    """Two links lead into it: the database's over a bridge, which it can be taken from without either end losing its carrier,
    and one for HTTP."""

    def __init__(self):
        self.name, of_us = f"cellmap{os.getpid()}", f"cm{os.getpid() % 100000}"
        self.bridge, self.port, self.http = f"{of_us}b", f"{of_us}d", f"{of_us}h"

    def make(self):
        ip("netns", "add", self.name)
        ip("link", "add", self.bridge, "type", "bridge")
        for link in (self.port, self.http):
            ip("link", "add", link, "type", "veth", "peer", "name", link + "x", "netns", self.name)
        self.mend()
        for link, address in ((self.bridge, DATABASE), (self.http, NEAR)):
            ip("address", "add", f"{address}/24", "dev", link)
        for link in (self.bridge, self.port, self.http):
            ip("link", "set", link, "up")
        for link, address in ((self.port, "10.211.77.2"), (self.http, FAR)):
            ip("-n", self.name, "address", "add", f"{address}/24", "dev", link + "x")
            ip("-n", self.name, "link", "set", link + "x", "up")

    def cut(self):
        ip("link", "set", self.port, "nomaster")

    def mend(self):
        ip("link", "set", self.port, "master", self.bridge)

    def remove(self):
        for words in (("link", "del", self.port), ("link", "del", self.http), ("link", "del", self.bridge), ("netns", "del", self.name)):
            subprocess.run(["ip", *words], capture_output=True)


class FarServer(Server):
    def __init__(self, namespace, *arguments, log):
        super().__init__(*arguments, "--insecure", log=log)
        self.command[self.command.index("--listen") + 1] = f"{FAR}:{self.port}"
        self.command = ["ip", "netns", "exec", namespace.name, *self.command]
        self.api = Api(self.port, FAR)


def while_cut(options, namespace, far, robots):
    cut = time.monotonic()
    namespace.cut()
    rounds = [asked(far), asked(far)]
    time.sleep(2 if options.short else 20)
    namespace.mend()
    healed, sent = time.monotonic(), count_of(robots[:1])
    wait_until(lambda: far.get("/readyz"), 60, "the far server is ready again")
    wait_until(lambda: count_of(robots[:1]) > sent, 60, "its robot goes on")
    again_s = time.monotonic() - healed
    afterwards = asked(far)
    for robot in robots:
        robot.stop()
    wrong = [f"a server without its database told {what} {told} after {seconds} s" for told_of in rounds
             for what, (told, seconds) in told_of.items() if told != "503 unavailable" or seconds > DEADLINE_S]
    wrong += [f"afterwards {what} was told {told}" for what, (told, _) in afterwards.items() if told != "answered"]
    wrong += [line for api in (far, robots[1].apis[0]) for line in lost(api, robots)]
    others = {refusal for robot in robots for refusal in robot.refused} - {(503, "unavailable")}
    if others:
        wrong.append(f"robots were refused with {others}")
    row = {"cut_s": round(healed - cut, 1), "requests": rounds, "longest_s": max(s for told in rounds for _, s in told.values()),
           "must_longest_s": DEADLINE_S, "goes_on_after_s": round(again_s, 1), "acknowledged": count_of(robots),
           "other_server_waited_s": round(longest_silence_s(robots[1:], cut - 1), 1), "must_other_waited_s": 15, "wrong": wrong}
    if row["other_server_waited_s"] > 15:
        wrong.append(f"the server that was not cut off waited {row['other_server_waited_s']} s")
    note(f"partition: cut for {row['cut_s']} s, every request there ended with 503 within {row['longest_s']} s (must {DEADLINE_S}), the other "
         f"server waited {row['other_server_waited_s']} s (must 15), {row['acknowledged']} CELLs acknowledged, none lost; goes on "
         f"{row['goes_on_after_s']} s after healing, without a restart")
    return row


def run(options, folder):
    namespace, servers, database = Namespace(), [], Cluster(listen_addresses=DATABASE)
    try:
        namespace.make()
        database.create()
        with open(database.data / "pg_hba.conf", "a", encoding="utf-8") as rules:
            rules.write("host all all 10.211.77.0/24 trust\n")
        database.sql("SELECT pg_reload_conf()")
        servers = [Server(options.cellmapd, database.address, folder / "data", log=folder / "near.log")]
        world = World(options, folder, servers[0])
        far = FarServer(namespace, options.cellmapd, f"postgresql://postgres@{DATABASE}/postgres", folder / "data", "--role", "api",
                        log=folder / "far.log")
        servers.append(far)
        far.start()
        robots = [Uploader("far", [far.api], world), Uploader("near", [world.api], world)]
        for robot in robots:
            robot.start()
        time.sleep(3)
        return while_cut(options, namespace, far.api, robots)
    finally:
        for server in servers:
            server.kill()
        database.remove()
        namespace.remove()
