"""The bytes of CELLs in an object store beside the database (a stand-in, which checks signatures). It hangs under writes: each ends
with 503 within its deadline, hot CELLs and all that needs no bytes go on, readiness turns red; when it is back all goes on without
a restart, no acknowledged CELL is lost, and the database has no frame."""
import os
import signal
import subprocess
import time

from database import Cluster
from support import TESTS, Server, World, note, timed, wait_until
from uploader import Uploader, count_of, lost
from writers import CELL, content

HANGS_S = 12
DEADLINE_S = 15  # of any request meanwhile


def stand_in(order, folder):
    subprocess.run([str(TESTS / "support" / "object_store.sh"), order, str(folder)], check=True, stdout=subprocess.DEVNULL)


def while_hanging(world, robot, process):
    cell, (digest, _) = min(world.cells.items())
    hot = f"/v1/maps/town/cells/{cell}?hash={digest}"
    world.api.call("GET", hot, accept=CELL)
    os.kill(process, signal.SIGSTOP)
    try:
        begun = time.monotonic()
        ready = timed(lambda: world.api.call("GET", "/readyz"))
        others = {"hot": timed(lambda: world.api.call("GET", hot, accept=CELL)), "graph": timed(lambda: world.api.get("/v1/maps/town/pose-graph")),
                  "map": timed(lambda: world.api.get("/v1/maps/town"))}
        time.sleep(max(0.0, HANGS_S - (time.monotonic() - begun)))
    finally:
        os.kill(process, signal.SIGCONT)
    sent = count_of([robot])
    wait_until(lambda: count_of([robot]) > sent, 30, "a robot goes on")
    wait_until(lambda: world.api.call("GET", "/readyz"), 30, "the server is ready again")
    wrong = [f"while it hung {what} was told {answer} after {seconds} s" for what, (answer, seconds) in others.items()
             if answer != "answered" or seconds > 2]
    if ready[0] != "503 unavailable":
        wrong.append(f"while it hung readiness was {ready}")
    if not robot.refused or set(robot.refused) != {(503, "unavailable")} or robot.lost:
        wrong.append(f"writes were refused with {dict(robot.refused)}, {robot.lost} without an answer")
    if robot.longest_s > DEADLINE_S:
        wrong.append(f"a write took {robot.longest_s:.1f} s")
    return ready, wrong


def run(options, folder):
    database, server, objects = Cluster().create(), None, folder / "objects"
    try:
        stand_in("start", objects)
        if not (objects / "address").exists():
            return {"wrong": ["its stand-in does not start; see above"]}
        os.environ["AWS_ACCESS_KEY_ID"] = os.environ["AWS_SECRET_ACCESS_KEY"] = "S3RVER"
        server = Server(options.cellmapd, database.address, folder / "data", "--blobs", "s3://cells/scale", "--blobs-endpoint",
                        (objects / "address").read_text().strip(), log=folder / "server.log")
        world = World(options, folder, server)
        before = content(world.api, "town")
        robot = Uploader("robot", [world.api], world)
        robot.start()
        wait_until(lambda: count_of([robot]) > 5, 30, "a robot writes")
        ready, wrong = while_hanging(world, robot, int((objects / "pid").read_text()))
        robot.stop()
        in_database = int(database.sql("SELECT COALESCE(SUM(LENGTH(frame)), 0) FROM blob"))
        if in_database:
            wrong.append(f"the database has {in_database} bytes of frames")
        if content(world.api, "town") != before:
            wrong.append("the map is another one now")
        if b"S3RVER" in (folder / "server.log").read_bytes():
            wrong.append("the log tells a key")
        wrong += lost(world.api, [robot])
        note(f"object-store, hanging {HANGS_S} s: writes were refused {sum(robot.refused.values())} times with 503, the longest after "
             f"{robot.longest_s:.1f} s (must {DEADLINE_S}), readiness red after {ready[1]} s, hot CELLs and poses went on; "
             f"{count_of([robot])} CELLs acknowledged, {'none' if not wrong else 'SOMETHING'} lost, no frame in the database")
        return {"acknowledged": count_of([robot]), "refused": sum(robot.refused.values()), "longest_s": robot.longest_s,
                "readiness": ready, "wrong": wrong}
    finally:
        if server:
            server.kill()
        if objects.exists():
            stand_in("stop", objects)
        database.remove()
