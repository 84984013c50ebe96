"""A database whose disk fills up: writes are refused with 507 `disk-full`, reads go on; once there is room again writes go on too,
without a restart, and nothing that was acknowledged is lost."""
import subprocess
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

from database import Cluster
from support import Refused, Server, World, note, wait_until
from uploader import Uploader, count_of, lost
from writers import content

ROOM_MIB = 160


@contextmanager
def small_disk():
    folder = Path(tempfile.mkdtemp(prefix="cellmap-pg-"))
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={ROOM_MIB}m", "none", str(folder)], check=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)
        folder.rmdir()


def fill(folder):
    """A file of others that takes all the room there is."""
    with open(folder / "of-others", "wb", buffering=0) as file:
        try:
            while file.write(bytes(1 << 20)):
                pass
        except OSError:
            pass


def run(options, folder):
    # Write-ahead log is made in advance, so that what fills the disk are tables: without it the database would stop.
    with small_disk() as disk:
        database, server = Cluster(disk, max_wal_size="48MB", min_wal_size="32MB", wal_recycle="off"), None
        try:
            database.create()
            server = Server(options.cellmapd, database.address, folder / "data", log=folder / "server.log")
            world = World(options, folder, server)
            return fill_up(world, disk)
        finally:
            if server:
                server.kill()
            database.remove()


def fill_up(world, disk):
    before = content(world.api, "town")
    robots = [Uploader("full", [world.api], world)]
    robots[0].start()
    wait_until(lambda: count_of(robots) > 20, 30, "a robot sends")
    fill(disk)
    wait_until(lambda: robots[0].refused, 60, "writes are refused")
    time.sleep(3)
    refused, sent = dict(robots[0].refused), count_of(robots)
    wrong = [] if content(world.api, "town") == before else ["reads do not go on while the disk is full"]
    try:
        world.api.send("POST", "/v1/maps", {"name": "one-more"})
    except Refused as refusal:
        refused[refusal.status, refusal.code] = refused.get((refusal.status, refusal.code), 0) + 1
    (disk / "of-others").unlink()
    wait_until(lambda: count_of(robots) > sent + 5, 60, "writes go on")
    robots[0].stop()
    wrong += list(lost(world.api, robots))
    others = refused.keys() - {(507, "disk-full"), (503, "unavailable")}
    if others or (507, "disk-full") not in refused:
        wrong.append(f"a full disk was told as {refused}")
    row = {"refused": {f"{status} {code}": count for (status, code), count in refused.items()},
           "acknowledged_before": sent, "acknowledged_after": count_of(robots) - sent, "wrong": wrong}
    note(f"full-disk: refused with {row['refused']}, reads went on; {sent} CELLs acknowledged before and {row['acknowledged_after']} after there "
         f"was room again, {len(wrong)} lost (must 0), no restart")
    return row
