"""PostgreSQL servers that can be killed, followed by a standby, promoted, starved of disk. Each is reached by a socket in its
folder, and where asked for by TCP too."""
import atexit
import os
import shutil
import signal
import subprocess
import tempfile
from pathlib import Path


def programs():
    """The folder of PostgreSQL's programs, or None."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[4]))
    return found[-1].parent if found else None


def as_server(command):
    """PostgreSQL refuses to run as root."""
    return ["setpriv", "--reuid", "postgres", "--regid", "postgres", "--init-groups", *command] if os.geteuid() == 0 else command


def children(pid):
    return [int(child) for task in Path(f"/proc/{pid}/task").iterdir() for child in (task / "children").read_text().split()]


class Cluster:
    """`settings`: of postgresql.conf. `folder`: an empty one of its own (default: a new one, which `remove` removes)."""

    def __init__(self, folder=None, **settings):
        self.folder = Path(folder or tempfile.mkdtemp(prefix="cellmap-pg-"))  # short: a socket's path has at most 107 bytes
        if os.geteuid() == 0:
            shutil.chown(self.folder, "postgres", "postgres")
        atexit.register(self.remove)  # also where a row is broken off
        self.data = self.folder / "data"
        self.settings = {"listen_addresses": "", "unix_socket_directories": str(self.folder), "max_connections": 200,
                         "fsync": "off", **settings}

    def call(self, program, *arguments):
        done = subprocess.run(as_server([str(programs() / program), *map(str, arguments)]), capture_output=True, text=True, cwd="/")
        if done.returncode:
            raise RuntimeError(f"{program}: {done.stderr[-500:]} {self.log()}")
        return done.stdout

    def log(self):
        file = self.folder / "log"
        return file.read_text()[-2000:] if file.exists() else ""

    def create(self):
        self.call("initdb", "--pgdata", self.data, "--username", "postgres", "--auth", "trust", "--encoding", "UTF8", "--locale", "C")
        return self.start()

    def start(self):
        options = " ".join(f"-c {name}='{value}'" for name, value in self.settings.items())
        self.call("pg_ctl", "--pgdata", self.data, "--log", self.folder / "log", "--wait", "--options", options, "start")
        return self

    def standby(self, **settings):
        """Another one that follows this one; each write waits for it from now on."""
        other = Cluster(**settings)
        self.call("pg_basebackup", "--pgdata", other.data, "--write-recovery-conf", "--checkpoint", "fast", "--wal-method", "stream",
                  "--dbname", f"host={self.folder} user=postgres application_name=standby")
        other.start()
        self.sql("ALTER SYSTEM SET synchronous_standby_names = 'standby'")
        self.sql("SELECT pg_reload_conf()")
        return other

    def promote(self):
        self.call("pg_ctl", "--pgdata", self.data, "--wait", "promote")

    def processes(self):
        main = int((self.data / "postmaster.pid").read_text().split()[0])
        return [main, *children(main)]

    def signal(self, which):
        """All its processes at once, as far as they are still there."""
        for process in self.processes():
            try:
                os.kill(process, which)
            except ProcessLookupError:
                pass

    def kill(self):
        """As when its machine loses power, but for what the disk was told."""
        self.signal(signal.SIGKILL)

    def sql(self, text):
        return self.call("psql", "-XAtq", "--host", self.folder, "--username", "postgres", "--dbname", "postgres", "--command", text).strip()

    def script(self, text):
        """What psql prints of statements that may be long."""
        file = self.folder / "script.sql"
        file.write_text(text)
        return self.call("psql", "-XAtq", "--set", "ON_ERROR_STOP=1", "--host", self.folder, "--username", "postgres", "--dbname",
                         "postgres", "--file", file)

    def stop(self):
        self.call("pg_ctl", "--pgdata", self.data, "--mode", "immediate", "stop")

    def remove(self):
        """Whatever state it is in, also twice."""
        atexit.unregister(self.remove)
        try:
            self.stop()
        except RuntimeError:
            pass
        shutil.rmtree(self.folder, ignore_errors=True)

    @property
    def address(self):
        return address_of(self)


def address_of(*clusters):
    """The one of these that can be written to."""
    hosts = ",".join(str(cluster.folder) for cluster in clusters)
    return f"postgresql:///postgres?host={hosts}&user=postgres" + ("&target_session_attrs=read-write" if len(clusters) > 1 else "")
