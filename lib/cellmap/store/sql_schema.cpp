#include "cellmap/store/sql_schema.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace cellmap {
namespace {

// Version 1. Written for SQLite; an engine with other types translates them. Positions are columns,
// since queries look into them; rotations, matrices and scores are bytes (store/row_codec.hpp).
constexpr const char* kVersion1 = R"sql(
CREATE TABLE map (
  id             INTEGER PRIMARY KEY AUTOINCREMENT,
  name           TEXT    NOT NULL UNIQUE,
  lattice_kind   INTEGER NOT NULL,
  lattice_size   INTEGER NOT NULL,
  created        INTEGER NOT NULL,            -- Unix time, ns
  revision       INTEGER NOT NULL DEFAULT 0,
  next_constraint INTEGER NOT NULL DEFAULT 1,
  -- Sums over the tables below, so that a summary costs nothing.
  cells          INTEGER NOT NULL DEFAULT 0,
  planes         INTEGER NOT NULL DEFAULT 0,
  constraints    INTEGER NOT NULL DEFAULT 0,  -- not removed
  encoded_bytes  INTEGER NOT NULL DEFAULT 0,
  stored_bytes   INTEGER NOT NULL DEFAULT 0,
  scans          INTEGER NOT NULL DEFAULT 0,
  raw_points     INTEGER NOT NULL DEFAULT 0,
  voxel_points   INTEGER NOT NULL DEFAULT 0
);

CREATE TABLE session (
  map            INTEGER NOT NULL REFERENCES map(id),
  name           TEXT    NOT NULL,
  PRIMARY KEY (map, name)
) WITHOUT ROWID;

-- The bytes of CELLs by content, shared between maps. No scan of metadata touches this table.
CREATE TABLE blob (
  hash           BLOB    PRIMARY KEY,         -- of the encoded CELL
  encoded_bytes  INTEGER NOT NULL,
  checksum       BLOB    NOT NULL,            -- SHA-256 of frame: SQLite has none of its own
  frame          BLOB    NOT NULL             -- one zstd frame
);

-- What is known of a CELL, with its current pose.
CREATE TABLE cell (
  map            INTEGER NOT NULL REFERENCES map(id),
  id             INTEGER NOT NULL,
  hash           BLOB    NOT NULL REFERENCES blob(hash),
  session        TEXT    NOT NULL,
  sequence       INTEGER NOT NULL,
  planes         INTEGER NOT NULL,
  encoded_bytes  INTEGER NOT NULL,
  added          INTEGER NOT NULL,            -- revision
  moved          INTEGER NOT NULL,            -- revision
  x              REAL    NOT NULL,            -- T_map_cell, m
  y              REAL    NOT NULL,
  z              REAL    NOT NULL,
  rotation       BLOB    NOT NULL,
  gx             INTEGER NOT NULL,            -- floor(x / 64 m), floor(y / 64 m)
  gy             INTEGER NOT NULL,
  PRIMARY KEY (map, id)
) WITHOUT ROWID;
CREATE INDEX cell_by_place ON cell (map, gx, gy, x, y, z);
CREATE UNIQUE INDEX cell_by_sequence ON cell (map, session, sequence);
CREATE INDEX cell_by_change ON cell (map, moved);
CREATE INDEX cell_by_hash ON cell (hash);

-- Every pose that a CELL has had, by the revision that brought it.
CREATE TABLE cell_pose (
  map            INTEGER NOT NULL,
  cell           INTEGER NOT NULL,
  revision       INTEGER NOT NULL,
  x              REAL    NOT NULL,
  y              REAL    NOT NULL,
  z              REAL    NOT NULL,
  rotation       BLOB    NOT NULL,
  PRIMARY KEY (map, cell, revision),
  FOREIGN KEY (map, cell) REFERENCES cell(map, id)
) WITHOUT ROWID;

-- A CELL's stretch of its drive.
CREATE TABLE cell_scans (
  map            INTEGER NOT NULL,
  cell           INTEGER NOT NULL,
  T_odom_cell    BLOB    NOT NULL,
  scans          BLOB    NOT NULL,
  PRIMARY KEY (map, cell),
  FOREIGN KEY (map, cell) REFERENCES cell(map, id)
) WITHOUT ROWID;

-- Constraints are never deleted from a living map: old revisions still see them.
CREATE TABLE pose_constraint (
  map            INTEGER NOT NULL,
  id             INTEGER NOT NULL,
  added          INTEGER NOT NULL,            -- revision
  removed        INTEGER,                     -- revision
  from_cell      INTEGER NOT NULL,
  to_cell        INTEGER NOT NULL,
  kind           INTEGER NOT NULL,
  origin         INTEGER NOT NULL,
  T_from_to      BLOB    NOT NULL,
  information    BLOB    NOT NULL,
  scores         BLOB    NOT NULL,
  PRIMARY KEY (map, id),
  FOREIGN KEY (map, from_cell) REFERENCES cell(map, id),
  FOREIGN KEY (map, to_cell) REFERENCES cell(map, id)
) WITHOUT ROWID;
CREATE INDEX pose_constraint_by_cells ON pose_constraint (map, from_cell, to_cell);
CREATE INDEX pose_constraint_by_target ON pose_constraint (map, to_cell);
CREATE INDEX pose_constraint_by_added ON pose_constraint (map, added);
CREATE INDEX pose_constraint_by_removed ON pose_constraint (map, removed);

-- Jobs outlive their maps, and may begin before them.
CREATE TABLE job (
  id             INTEGER PRIMARY KEY AUTOINCREMENT,
  map            TEXT    NOT NULL,
  kind           TEXT    NOT NULL,
  request        TEXT    NOT NULL,
  state          TEXT    NOT NULL,
  scans_done     INTEGER NOT NULL,
  scans_total    INTEGER NOT NULL,
  cells_done     INTEGER NOT NULL,
  error_code     TEXT    NOT NULL,
  error_message  TEXT    NOT NULL,
  created        INTEGER NOT NULL,
  started        INTEGER NOT NULL,
  updated        INTEGER NOT NULL
);
CREATE INDEX job_by_map ON job (map, id);
)sql";

// Version 2: who drove a session, and since when its poses are in the map frame.
constexpr const char* kVersion2 = R"sql(
ALTER TABLE session ADD COLUMN robot          TEXT    NOT NULL DEFAULT '';
ALTER TABLE session ADD COLUMN sensor         TEXT    NOT NULL DEFAULT '';
ALTER TABLE session ADD COLUMN odometry_frame TEXT    NOT NULL DEFAULT '';
ALTER TABLE session ADD COLUMN started        INTEGER NOT NULL DEFAULT 0;  -- Unix time, ns
ALTER TABLE session ADD COLUMN aligned        INTEGER DEFAULT 0;           -- revision; NULL: not yet
)sql";

// Version 3: how constraints are judged, and the revision that last changed it; what a CELL counts
// for in the sums of its map, so that it can leave; where the map lies on Earth.
constexpr const char* kVersion3 = R"sql(
ALTER TABLE pose_constraint ADD COLUMN weight REAL    NOT NULL DEFAULT 1;
ALTER TABLE pose_constraint ADD COLUMN pinned INTEGER NOT NULL DEFAULT 0;
ALTER TABLE pose_constraint ADD COLUMN judged INTEGER NOT NULL DEFAULT 0;
CREATE INDEX pose_constraint_by_judged ON pose_constraint (map, judged);
ALTER TABLE cell ADD COLUMN scans        INTEGER NOT NULL DEFAULT 0;
ALTER TABLE cell ADD COLUMN raw_points   INTEGER NOT NULL DEFAULT 0;
ALTER TABLE cell ADD COLUMN voxel_points INTEGER NOT NULL DEFAULT 0;
ALTER TABLE map ADD COLUMN next_cell    INTEGER NOT NULL DEFAULT 1;  -- above all that were removed
ALTER TABLE map ADD COLUMN oldest       INTEGER NOT NULL DEFAULT 0;  -- revision that can be read
ALTER TABLE map ADD COLUMN latitude_deg  REAL;                       -- NULL: not known
ALTER TABLE map ADD COLUMN longitude_deg REAL;
ALTER TABLE map ADD COLUMN height_m      REAL;
ALTER TABLE map ADD COLUMN R_enu_map     BLOB;
)sql";

// Version 4: texts that are kept with a map (store/documents.hpp).
constexpr const char* kVersion4 = R"sql(
CREATE TABLE document (
  map            INTEGER NOT NULL REFERENCES map(id),
  name           TEXT    NOT NULL,
  content        TEXT    NOT NULL,
  PRIMARY KEY (map, name)
) WITHOUT ROWID;
)sql";

// Version 5: CELLs in other bytes than raw ones (codec/kept_cell.hpp). `cell.hash` and `blob.hash`
// are from now on of the kept bytes; where these are compact, the CELL that they decode to has
// another one.
constexpr const char* kVersion5 = R"sql(
ALTER TABLE map ADD COLUMN encoding  INTEGER NOT NULL DEFAULT 1;  -- of CELLs to come
ALTER TABLE map ADD COLUMN bound_um  INTEGER NOT NULL DEFAULT 0;
ALTER TABLE cell ADD COLUMN encoding INTEGER NOT NULL DEFAULT 1;
ALTER TABLE cell ADD COLUMN bound_um INTEGER NOT NULL DEFAULT 0;
ALTER TABLE cell ADD COLUMN identity BLOB;              -- raw hash of the CELL; NULL: as hash
ALTER TABLE cell ADD COLUMN source   BLOB;              -- raw hash before coding; NULL: as identity
ALTER TABLE cell ADD COLUMN replaced INTEGER NOT NULL DEFAULT 0;  -- revision that changed identity
)sql";

// Version 6: who carries out a job (store/claims.hpp).
constexpr const char* kVersion6 = R"sql(
ALTER TABLE job ADD COLUMN alone        INTEGER NOT NULL DEFAULT 1;   -- in its map, in order
ALTER TABLE job ADD COLUMN worker       TEXT    NOT NULL DEFAULT '';  -- '': nobody
ALTER TABLE job ADD COLUMN claim        INTEGER NOT NULL DEFAULT 0;   -- rises with every claim
ALTER TABLE job ADD COLUMN lease_ends   INTEGER NOT NULL DEFAULT 0;   -- Unix time, ns
ALTER TABLE job ADD COLUMN cancel_asked INTEGER NOT NULL DEFAULT 0;
UPDATE job SET alone = 0 WHERE kind = 'ingest' AND request NOT LIKE '%"path"%';
CREATE INDEX job_unfinished ON job (id) WHERE state IN ('queued', 'running');
)sql";

// Version 7: parts of jobs that other workers make (store/parts.hpp). Without a foreign key: an
// offer would wait for whoever writes for the job.
constexpr const char* kVersion7 = R"sql(
CREATE TABLE job_part (
  job            INTEGER NOT NULL,
  claim          INTEGER NOT NULL,            -- of the job, when the part was offered
  first_sequence INTEGER NOT NULL,            -- of its CELLs
  first_scan     INTEGER NOT NULL,
  scan_count     INTEGER NOT NULL,
  worker         TEXT    NOT NULL DEFAULT '', -- '': nobody has taken it
  checksum       BLOB,                        -- SHA-256 of made
  made           BLOB,                        -- a zstd frame; NULL: not yet
  PRIMARY KEY (job, claim, first_sequence)
);
)sql";

// Version 8: what was made of a CELL and need not be made again (store/descriptions.hpp). With row
// ids: rows of more than a quarter of a page would take another page each.
constexpr const char* kVersion8 = R"sql(
CREATE TABLE cell_description (
  map            INTEGER NOT NULL,
  cell           INTEGER NOT NULL,
  hash           BLOB    NOT NULL,            -- identity of the CELL that it was made of
  checksum       INTEGER NOT NULL,            -- XXH3 of bytes
  bytes          BLOB    NOT NULL,
  PRIMARY KEY (map, cell),
  FOREIGN KEY (map, cell) REFERENCES cell(map, id)
);
)sql";

// Version 9: frames that are objects beside the database (store/blobs.hpp).
constexpr const char* kVersion9 = R"sql(
ALTER TABLE blob ADD COLUMN frame_bytes INTEGER;  -- size of the object; NULL: it is in frame
)sql";

constexpr std::array kMigrations = {kVersion1, kVersion2, kVersion3, kVersion4, kVersion5,
                                    kVersion6, kVersion7, kVersion8, kVersion9};

}  // namespace

std::span<const char* const> sql_schema_steps() { return kMigrations; }

std::int64_t grid_key(double coordinate_m) {
  constexpr double kLimit = 1e15;  // keeps the conversion defined; no CELL is that far away
  return static_cast<std::int64_t>(
      std::floor(std::clamp(coordinate_m, -kLimit, kLimit) / kGridSizeM));
}

}  // namespace cellmap
