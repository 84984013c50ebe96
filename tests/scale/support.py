"""What the rows share, most of it from the other tests of whole programs."""
import json
import shutil
import sys
import time
from pathlib import Path

TESTS = Path(__file__).parent.parent
DEPLOY = TESTS.parent / "server" / "deploy"
for folder in ("crash", "load", "e2e"):
    sys.path.append(str(TESTS / folder))
from behind_proxy import haproxy_command, nginx_command  # noqa: E402,F401
from load import World as OneServer, memory_mib, note, percentile, processor_s  # noqa: E402,F401
from server import Api, Lost, Refused, Server, free_port  # noqa: E402,F401


class World(OneServer):
    """A map in a database, asked for through a proxy."""

    def __init__(self, options, folder, server):
        super().__init__(options, folder, server)
        self.proxy_port = free_port()
        self.through_proxy = Api(self.proxy_port)
        self.url = f"http://127.0.0.1:{self.proxy_port}"

    @staticmethod
    def answer_of(fleet):
        return json.loads(fleet.communicate()[0])


def timed(act):
    """What came of it, in words, and how many seconds it took."""
    begun = time.monotonic()
    try:
        act()
        what = "answered"
    except Refused as refused:
        what = f"{refused.status} {refused.code}"
    except Lost:
        what = "no answer"
    return what, round(time.monotonic() - begun, 2)


def wait_until(act, seconds, what):
    """Until `act` succeeds and returns something true; its result."""
    deadline, last = time.monotonic() + seconds, None
    while time.monotonic() < deadline:
        try:
            last = act()
            if last:
                return last
        except (Lost, Refused, OSError) as error:
            last = error
        time.sleep(0.05)
    raise RuntimeError(f"waited {seconds} s until {what}; last: {last}")


def missing(*programs):
    """Those of these programs that are not installed."""
    return [program for program in programs if not shutil.which(program)]
