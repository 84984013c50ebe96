"""The link of slow_link.py between servers and a database, as an object."""
import subprocess
import sys
from pathlib import Path


class Link:
    def __init__(self, database):
        self.folder = database.folder / "link"
        self.folder.mkdir()
        database.folder.chmod(0o755)
        self.process = subprocess.Popen(
            [sys.executable, str(Path(__file__).parent / "slow_link.py"), str(self.folder / ".s.PGSQL.5432"),
             str(database.folder / ".s.PGSQL.5432")], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.heard()

    def heard(self):
        if not self.process.stdout.readline():
            raise RuntimeError("the link ended")

    def order(self, *words):
        """Carried out when this returns."""
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        self.heard()

    def end(self):
        self.process.kill()
        self.process.wait()

    @property
    def address(self):
        return f"postgresql:///postgres?host={self.folder}&user=postgres"
