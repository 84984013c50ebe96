#include "cellmap/store/sql_reads.hpp"

#include "cellmap/store/row_codec.hpp"
#include "cellmap/store/sql_cells.hpp"

namespace cellmap {
namespace {

std::string select_map(const std::string& condition) {
  return std::string(
             "SELECT id, name, lattice_kind, lattice_size, created, revision, next_constraint, "
             "cells, planes, constraints, encoded_bytes, stored_bytes, scans, raw_points, "
             "voxel_points, next_cell, oldest, latitude_deg, longitude_deg, height_m, R_enu_map, "
             "encoding, bound_um FROM map ") +
         condition;
}

std::string select_constraint(const char* condition) {
  return std::string(
             "SELECT id, from_cell, to_cell, kind, origin, T_from_to, information, scores, "
             "weight, pinned FROM pose_constraint ") +
         condition;
}

std::string select_job(const char* condition) {
  return std::string(
             "SELECT id, map, kind, request, state, scans_done, scans_total, cells_done, "
             "error_code, error_message, created, started, updated FROM job ") +
         condition;
}

/// A column that holds an enumeration.
std::uint8_t integer_between(const Query& row, int column, std::int64_t least, std::int64_t most) {
  const std::int64_t value = row.integer(column);
  if (value < least || value > most) {
    throw Error(ErrorCode::kCorruptData,
                "store: a kind or origin is unknown; use a newer program or restore a backup");
  }
  return static_cast<std::uint8_t>(value);
}

MapRow map_from_row(const Query& row) {
  MapRow map;
  map.key = row.integer(0);
  map.info.name = row.text(1);
  map.info.lattice.kind = static_cast<LatticeKind>(integer_between(row, 2, 0, 255));
  map.info.lattice.size = row.unsigned32(3);
  map.info.lattice.validate();
  map.info.created = row.integer(4);
  map.info.revision = row.unsigned64(5);
  map.next_constraint = row.unsigned32(6);
  map.info.cells = row.unsigned64(7);
  map.info.planes = row.unsigned64(8);
  map.info.constraints = row.unsigned64(9);
  map.info.encoded_bytes = row.unsigned64(10);
  map.info.stored_bytes = row.unsigned64(11);
  map.info.scans = row.unsigned64(12);
  map.info.raw_points = row.unsigned64(13);
  map.info.voxel_points = row.unsigned64(14);
  map.next_cell.value = row.unsigned32(15);
  map.oldest = row.unsigned64(16);
  if (!row.is_null(17)) {
    const Pose R_enu_map = pose_from_columns(Eigen::Vector3d::Zero(), row.bytes(20));
    map.info.georeference = {row.real(17), row.real(18), row.real(19), R_enu_map.linear()};
  }
  map.info.form = form_from_row(row, 21);
  return map;
}

MapRow find_map(SqlConnection& connection, const std::string& name, const std::string& lock) {
  Query row(connection, select_map("WHERE name = ?" + lock), name);
  if (!row.next()) throw no_map(name);
  return map_from_row(row);
}

Constraint constraint_from_row(const Query& row) {
  Constraint constraint;
  constraint.id.value = row.unsigned32(0);
  constraint.from.value = row.unsigned32(1);
  constraint.to.value = row.unsigned32(2);
  constraint.kind = static_cast<ConstraintKind>(integer_between(row, 3, 1, 3));
  constraint.origin = static_cast<ConstraintOrigin>(integer_between(row, 4, 1, 3));
  constraint.T_from_to = pose_from_bytes(row.bytes(5));
  constraint.information = information_from_bytes(row.bytes(6));
  constraint.scores = scores_from_bytes(row.bytes(7));
  constraint.weight = row.real(8);
  constraint.pinned = row.integer(9) != 0;
  return constraint;
}

JobRecord job_from_row(const Query& row) {
  JobRecord job;
  job.id.value = row.unsigned32(0);
  job.map = row.text(1);
  job.kind = row.text(2);
  job.request_json = row.text(3);
  job.state = job_state_from_string(row.text(4));
  job.scans_done = row.unsigned64(5);
  job.scans_total = row.unsigned64(6);
  job.cells_done = row.unsigned64(7);
  job.error_code = row.text(8);
  job.error_message = row.text(9);
  job.created = row.integer(10);
  job.started = row.integer(11);
  job.updated = row.integer(12);
  return job;
}

void require_revision(const MapRow& map, Revision revision) {
  if (revision > map.info.revision) {
    throw Error(ErrorCode::kNotFound, "map " + map.info.name + " has no revision " +
                                          std::to_string(revision) + "; its newest is " +
                                          std::to_string(map.info.revision));
  }
  if (revision < map.oldest) {
    throw Error(ErrorCode::kNotFound,
                "map " + map.info.name + " can no longer be read at revision " +
                    std::to_string(revision) + ": a session was removed from it at revision " +
                    std::to_string(map.oldest) + "; start from 0");
  }
}

std::set<CellId> read_unaligned(SqlConnection& connection, std::int64_t map, Revision revision) {
  std::set<CellId> unaligned;
  Query rows(connection,
             // CROSS: SQLite would look through all CELLs for those of no session.
             "SELECT cell.id FROM session CROSS JOIN cell WHERE cell.map = session.map "
             "AND cell.session = session.name AND session.map = ? "
             "AND (aligned IS NULL OR aligned > ?) AND added <= ?",
             map, revision, revision);
  while (rows.next()) unaligned.insert({rows.unsigned32(0)});
  return unaligned;
}

void read_current_graph(SqlConnection& connection, std::int64_t map, PoseGraph& graph) {
  Query poses(connection, "SELECT id, x, y, z, rotation FROM cell WHERE map = ? ORDER BY id", map);
  while (poses.next()) graph.nodes.emplace(CellId{poses.unsigned32(0)}, pose_from_row(poses, 1));
  graph.unaligned = read_unaligned(connection, map, graph.revision);
  Query constraints(connection, select_constraint("WHERE map = ? AND removed IS NULL ORDER BY id"),
                    map);
  while (constraints.next()) graph.constraints.push_back(constraint_from_row(constraints));
}

void read_old_graph(SqlConnection& connection, std::int64_t map, PoseGraph& graph) {
  Query poses(connection,
              "SELECT pose.cell, pose.x, pose.y, pose.z, pose.rotation FROM "
              "(SELECT cell, MAX(revision) AS revision FROM cell_pose "
              " WHERE map = ? AND revision <= ? GROUP BY cell) AS latest "
              "JOIN cell_pose AS pose ON pose.map = ? AND pose.cell = latest.cell "
              "AND pose.revision = latest.revision ORDER BY pose.cell",
              map, graph.revision, map);
  while (poses.next()) graph.nodes.emplace(CellId{poses.unsigned32(0)}, pose_from_row(poses, 1));
  graph.unaligned = read_unaligned(connection, map, graph.revision);
  Query constraints(connection,
                    select_constraint("WHERE map = ? AND added <= ? AND "
                                      "(removed IS NULL OR removed > ?) ORDER BY id"),
                    map, graph.revision, graph.revision);
  while (constraints.next()) graph.constraints.push_back(constraint_from_row(constraints));
}

}  // namespace

Error no_map(const std::string& name) {
  return Error(ErrorCode::kNotFound, "there is no map named '" + name + "'");
}

MapRow read_map_row(SqlConnection& connection, const std::string& name) {
  return find_map(connection, name, "");
}

MapRow lock_map_row(SqlConnection& connection, const std::string& name) {
  return find_map(connection, name, connection.lock_rows());
}

MapSummaries::Summary MapSummaries::read(SqlConnection& connection, const MapRow& row) {
  Summary summary;
  summary.revision = row.info.revision;
  Query bounds(connection,
               "SELECT MIN(x), MIN(y), MIN(z), MAX(x), MAX(y), MAX(z) FROM cell WHERE map = ? "
               "AND session NOT IN (SELECT name FROM session WHERE session.map = cell.map "
               "AND aligned IS NULL)",
               row.key);
  if (bounds.next() && !bounds.is_null(0)) {
    summary.bounds.min() = Eigen::Vector3d(bounds.real(0), bounds.real(1), bounds.real(2));
    summary.bounds.max() = Eigen::Vector3d(bounds.real(3), bounds.real(4), bounds.real(5));
  }
  Query sessions(connection, "SELECT name FROM session WHERE map = ? ORDER BY name", row.key);
  while (sessions.next()) summary.sessions.push_back(sessions.text(0));
  Query kept(connection,
             "SELECT encoding, bound_um, COUNT(*) FROM cell WHERE map = ? "
             "GROUP BY encoding, bound_um",
             row.key);
  while (kept.next()) summary.kept[form_from_row(kept, 0)] = kept.unsigned64(2);
  return summary;
}

MapInfo MapSummaries::complete(SqlConnection& connection, MapRow row) {
  const auto fill = [&](const Summary& summary) {
    row.info.bounds = summary.bounds;
    row.info.sessions = summary.sessions;
    row.info.kept = summary.kept;
    return row.info;
  };
  {
    const std::lock_guard lock(mutex_);
    const auto found = by_key_.find(row.key);
    if (found != by_key_.end() && found->second.revision == row.info.revision) {
      return fill(found->second);
    }
  }
  Summary summary = read(connection, row);
  fill(summary);
  const std::lock_guard lock(mutex_);
  constexpr std::size_t kMaxKept = 10'000;  // keys of deleted maps stay until then
  if (by_key_.size() >= kMaxKept) by_key_.clear();
  by_key_[row.key] = std::move(summary);
  return row.info;
}

std::vector<MapInfo> read_maps(SqlConnection& connection, MapSummaries& summaries) {
  std::vector<MapRow> found;
  Query rows(connection, select_map("ORDER BY name"));
  while (rows.next()) found.push_back(map_from_row(rows));
  std::vector<MapInfo> maps;
  for (MapRow& row : found) maps.push_back(summaries.complete(connection, std::move(row)));
  return maps;
}

PoseGraph read_pose_graph(SqlConnection& connection, const std::string& map,
                          std::optional<Revision> revision) {
  const MapRow row = read_map_row(connection, map);
  PoseGraph graph;
  graph.revision = revision.value_or(row.info.revision);
  graph.next_cell = row.next_cell;
  require_revision(row, graph.revision);
  if (graph.revision == row.info.revision) {
    read_current_graph(connection, row.key, graph);
  } else {
    read_old_graph(connection, row.key, graph);
  }
  return graph;
}

MapChanges read_changes(SqlConnection& connection, const std::string& map, Revision since) {
  const MapRow row = read_map_row(connection, map);
  if (since > 0) require_revision(row, since);
  MapChanges changes;
  changes.since = since;
  changes.revision = row.info.revision;
  for (CellRecord& cell : cells_changed_since(connection, row.key, since)) {
    if (cell.added > since) {
      changes.added.push_back(std::move(cell));
    } else {
      changes.moved.emplace(cell.id, cell.T_map_cell);
    }
  }
  changes.unaligned = read_unaligned(connection, row.key, changes.revision);
  const std::string order = order_of_changes(since);
  Query added(connection,
              select_constraint("WHERE map = ? AND added > ? AND removed IS NULL ") + order,
              row.key, since);
  while (added.next()) changes.added_constraints.push_back(constraint_from_row(added));
  Query removed(
      connection,
      "SELECT id FROM pose_constraint WHERE map = ? AND removed > ? AND +added <= ? " + order,
      row.key, since, since);
  while (removed.next()) changes.removed_constraints.push_back({removed.unsigned32(0)});
  Query judged(connection,
               "SELECT id, weight, pinned FROM pose_constraint WHERE map = ? AND judged > ? "
               "AND +added <= ? AND removed IS NULL " +
                   order,
               row.key, since, since);
  while (judged.next()) {
    changes.judged.emplace(ConstraintId{judged.unsigned32(0)},
                           Judgement{judged.real(1), judged.integer(2) != 0});
  }
  return changes;
}

std::vector<SessionInfo> read_sessions(SqlConnection& connection, const std::string& map) {
  std::vector<SessionInfo> sessions;
  Query rows(connection,
             "SELECT session.name, robot, sensor, odometry_frame, started, aligned, "
             "COUNT(cell.id), CAST(COALESCE(SUM(planes), 0) AS BIGINT), "
             "CAST(COALESCE(SUM(encoded_bytes), 0) AS BIGINT) "
             "FROM session "
             "LEFT JOIN cell ON cell.map = session.map AND cell.session = session.name "
             "WHERE session.map = ? GROUP BY session.name, robot, sensor, odometry_frame, started, "
             "aligned "
             "ORDER BY session.name",
             read_map_row(connection, map).key);
  while (rows.next()) {
    sessions.push_back({rows.text(0), rows.text(1), rows.text(2), rows.text(3), rows.integer(4),
                        !rows.is_null(5), rows.unsigned64(6), rows.unsigned64(7),
                        rows.unsigned64(8)});
  }
  return sessions;
}

JobRecord read_job(SqlConnection& connection, JobId id) {
  Query row(connection, select_job("WHERE id = ?"), id.value);
  if (!row.next()) {
    throw Error(ErrorCode::kNotFound, "there is no job " + std::to_string(id.value));
  }
  return job_from_row(row);
}

std::vector<JobRecord> read_jobs(SqlConnection& connection, const std::optional<std::string>& map) {
  std::vector<JobRecord> jobs;
  Query rows = map ? Query(connection, select_job("WHERE map = ? ORDER BY id"), *map)
                   : Query(connection, select_job("ORDER BY id"));
  while (rows.next()) jobs.push_back(job_from_row(rows));
  return jobs;
}

}  // namespace cellmap
