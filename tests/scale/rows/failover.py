"""A primary with a synchronous standby: all its processes are killed while robots send CELLs, the standby is promoted, and the
servers find it by themselves. No CELL that was acknowledged may be lost, nor anything of what was there before."""
import time

from database import Cluster, address_of
from support import Server, World, note, wait_until
from uploader import Uploader, count_of, longest_silence_s, lost
from writers import content


def run(options, folder):
    clusters, servers = [], []
    try:
        primary = Cluster(fsync="on").create()
        clusters.append(primary)
        standby = primary.standby(fsync="on")
        clusters.append(standby)
        wait_until(lambda: primary.sql("SELECT sync_state FROM pg_stat_replication") == "sync", 30, "the standby follows")
        servers = [Server(options.cellmapd, address_of(primary, standby), folder / "data", "--role", role, log=folder / f"{role}.log")
                   for role in ("all", "api")]
        world = World(options, folder, servers[0])
        servers[1].start()
        return fail_over(options, world, servers, primary, standby)
    finally:
        for server in servers:
            server.kill()
        for cluster in clusters:
            cluster.remove()


def fail_over(options, world, servers, primary, standby):
    seconds = 4 if options.short else 15
    before = content(world.api, "town")
    apis = [server.api for server in servers]
    robots = [Uploader(f"robot{i}", apis[i % 2:] + apis[:i % 2], world) for i in range(4)]
    for robot in robots:
        robot.start()
    time.sleep(seconds)
    primary.kill()
    killed, sent = time.monotonic(), count_of(robots)
    standby.promote()
    promoted = time.monotonic()
    time.sleep(seconds)
    for robot in robots:
        robot.stop()
    wrong = [line for server in servers for line in lost(server.api, robots)]
    if content(world.api, "town") != before:
        wrong.append("the map of before is another one now")
    others = {refusal for robot in robots for refusal in robot.refused} - {(503, "unavailable")}
    if others:
        wrong.append(f"robots were refused with {others}")
    row = {"acknowledged_before": sent, "acknowledged_after": count_of(robots) - sent, "lost": len(wrong), "must_lost": 0,
           "promoted_s": round(promoted - killed, 2), "writable_again_s": round(longest_silence_s(robots, killed - 0.5), 2),
           "refused_503": sum(sum(robot.refused.values()) for robot in robots), "connections_lost": sum(robot.lost for robot in robots),
           "longest_answer_s": round(max(robot.longest_s for robot in robots), 2), "wrong": wrong}
    if not row["acknowledged_after"]:
        wrong.append("nothing was written after the promotion")
    note(f"failover: {row['acknowledged_before']} CELLs acknowledged before the primary was killed and {row['acknowledged_after']} after, "
         f"{row['lost']} lost (must 0); promoted {row['promoted_s']} s after the kill, writable again after {row['writable_again_s']} s, "
         f"{row['refused_503']} requests refused with 503 meanwhile, longest answer {row['longest_answer_s']} s")
    return row
