"""A worker that carries out an ingest is killed, suspended, stopped, each in the middle of the drive: another one ends the job, to the
same CELLs, poses and constraints as undisturbed (tests/crash/takeover.py, with a database of its own)."""
import takeover
from database import Cluster
from support import note


def run(options, folder):
    database = Cluster().create()
    (folder / "data").mkdir()
    try:
        with takeover.Database(str(database.folder)) as own:
            takeover.run(options, folder, own)
    except AssertionError as failed:
        return {"wrong": [str(failed)]}
    finally:
        database.remove()
    note("worker-killed: killed at 1 and at 4 CELLs, suspended, stopped: another worker ended each job, with the same bytes")
    return {"wrong": []}
