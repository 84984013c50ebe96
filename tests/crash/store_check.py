"""What must hold in a store's file at any moment, read by SQL of its own: an independent second opinion."""
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

# Each must give no row.
RULES = {
    "a reference leads nowhere": "SELECT * FROM pragma_foreign_key_check",
    "a map's count of CELLs is wrong":
        "SELECT name FROM map WHERE cells <> (SELECT COUNT(*) FROM cell WHERE cell.map = map.id)",
    "a map's count of planes is wrong":
        "SELECT name FROM map WHERE planes <> (SELECT COALESCE(SUM(planes), 0) FROM cell WHERE cell.map = map.id)",
    "a map's count of constraints is wrong":
        "SELECT name FROM map WHERE constraints <> (SELECT COUNT(*) FROM pose_constraint AS c WHERE c.map = map.id AND c.removed IS NULL)",
    "a CELL has no drive": "SELECT map, id FROM cell WHERE NOT EXISTS (SELECT 1 FROM cell_scans AS s WHERE s.map = cell.map AND s.cell = cell.id)",
    "a CELL has no session": "SELECT map, id FROM cell WHERE NOT EXISTS (SELECT 1 FROM session AS s WHERE s.map = cell.map AND s.name = cell.session)",
    "a CELL has not the last of its poses":
        "SELECT map, id FROM cell WHERE NOT EXISTS (SELECT 1 FROM cell_pose AS p WHERE p.map = cell.map AND p.cell = cell.id AND p.revision = cell.moved "
        "AND p.x = cell.x AND p.y = cell.y AND p.z = cell.z AND p.rotation = cell.rotation)",
    "a CELL has not the first of its poses":
        "SELECT map, id FROM cell WHERE NOT EXISTS (SELECT 1 FROM cell_pose AS p WHERE p.map = cell.map AND p.cell = cell.id AND p.revision = cell.added)",
    "content that no CELL has": "SELECT hex(hash) FROM blob WHERE NOT EXISTS (SELECT 1 FROM cell WHERE cell.hash = blob.hash)",
    "a sequence has a gap":
        "SELECT map, session FROM cell GROUP BY map, session HAVING MAX(sequence) <> COUNT(*) - 1",
}

REVISIONS = """
SELECT added FROM cell WHERE map = :map UNION SELECT moved FROM cell WHERE map = :map
UNION SELECT revision FROM cell_pose WHERE map = :map UNION SELECT aligned FROM session WHERE map = :map AND aligned IS NOT NULL
UNION SELECT added FROM pose_constraint WHERE map = :map UNION SELECT judged FROM pose_constraint WHERE map = :map
UNION SELECT removed FROM pose_constraint WHERE map = :map AND removed IS NOT NULL"""


def check_revisions(database, with_pins):
    """Of a revision that only judged constraints anew, the next one may leave no trace: such maps are not held to have no gap."""
    for key, name, revision, oldest in database.execute("SELECT id, name, revision, oldest FROM map").fetchall():
        seen = {row[0] for row in database.execute(REVISIONS, {"map": key})}
        beyond = [r for r in seen if r > revision]
        if beyond:
            yield f"map {name} is at revision {revision} and holds traces of {max(beyond)}"
        gaps = set(range(oldest + 1, revision + 1)) - seen
        if gaps and name not in with_pins:
            yield f"map {name} has no trace of its revisions {sorted(gaps)[:5]}"


def check_store(file, scratch, with_pins=(), at_rest=False):
    """Lines that say what is wrong. Looks at a copy, so that the server finds what the crash left. `at_rest`: of a server
    that was stopped, so that no map may be in the making."""
    copy = Path(scratch) / "copy.db"
    for suffix in ("", "-wal"):
        Path(f"{copy}{suffix}").unlink(missing_ok=True)
        if Path(f"{file}{suffix}").exists():
            shutil.copy(f"{file}{suffix}", f"{copy}{suffix}")
    wrong = []
    with closing(sqlite3.connect(copy)) as database:
        verdict = [row[0] for row in database.execute("PRAGMA integrity_check")]
        if verdict != ["ok"]:
            return [f"integrity_check: {verdict[:3]}"]
        for rule, sql in RULES.items():
            rows = database.execute(sql).fetchmany(3)
            if rows:
                wrong.append(f"{rule}: {rows}")
        wrong += check_revisions(database, with_pins)
        staged = database.execute("SELECT name FROM map WHERE name LIKE '.%'").fetchall()
        if at_rest and staged:
            wrong.append(f"maps in the making are left: {staged}")
    return wrong
