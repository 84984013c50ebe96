#include "cellmap/store/sql_writes.hpp"

#include <set>
#include <tuple>

#include "cellmap/store/row_codec.hpp"
#include "cellmap/store/sql_contents.hpp"
#include "cellmap/store/sql_parts.hpp"
#include "cellmap/store/sql_reads.hpp"

namespace cellmap {
void insert_map(SqlConnection& connection, const std::string& name, const LatticeSpec& lattice,
                const CellForm& form, Stamp created) {
  {
    Query row(connection, "SELECT 1 FROM map WHERE name = ?", name);
    if (row.next()) {
      throw Error(ErrorCode::kAlreadyExists, "there is a map named '" + name + "' already");
    }
  }
  Query(connection,
        "INSERT INTO map (name, lattice_kind, lattice_size, created, encoding, bound_um) "
        "VALUES (?, ?, ?, ?, ?, ?)",
        name, static_cast<std::uint32_t>(lattice.kind), lattice.size, created,
        static_cast<std::uint32_t>(form.encoding), form.bound_um)
      .run();
}

void remove_map(SqlConnection& connection, std::int64_t map) {
  const std::set<ContentHash> contents = kept_contents(connection, map, {});
  hold_contents(connection, {}, {}, contents);
  for (const char* const statement :
       {"DELETE FROM pose_constraint WHERE map = ?", "DELETE FROM cell_scans WHERE map = ?",
        "DELETE FROM cell_description WHERE map = ?", "DELETE FROM cell_pose WHERE map = ?",
        "DELETE FROM session WHERE map = ?", "DELETE FROM document WHERE map = ?"}) {
    Query(connection, statement, map).run();
  }
  Query(connection, "DELETE FROM cell WHERE map = ?", map).run();
  remove_unused_contents(connection, contents);
  Query(connection, "DELETE FROM map WHERE id = ?", map).run();
}

void write_form(SqlConnection& connection, std::int64_t map, const CellForm& form) {
  Query(connection, "UPDATE map SET encoding = ?, bound_um = ? WHERE id = ?",
        static_cast<std::uint32_t>(form.encoding), form.bound_um, map)
      .run();
}

void write_document(SqlConnection& connection, std::int64_t map, const std::string& name,
                    const std::string& text) {
  Query(connection,
        "INSERT INTO document (map, name, content) VALUES (?, ?, ?) "
        "ON CONFLICT (map, name) DO UPDATE SET content = excluded.content",
        map, name, text)
      .run();
}

void write_georeference(SqlConnection& connection, std::int64_t map,
                        const std::optional<Georeference>& georeference) {
  std::optional<double> latitude, longitude, height;
  std::optional<Bytes> rotation;
  if (georeference) {
    latitude = georeference->latitude_deg;
    longitude = georeference->longitude_deg;
    height = georeference->height_m;
    Pose pose = Pose::Identity();
    pose.linear() = georeference->R_enu_map;
    rotation = rotation_to_bytes(pose);
  }
  Query(connection,
        "UPDATE map SET latitude_deg = ?, longitude_deg = ?, height_m = ?, R_enu_map = ? "
        "WHERE id = ?",
        latitude, longitude, height, rotation, map)
      .run();
}

void insert_session(SqlConnection& connection, const MapRow& map, const SessionInfo& session) {
  const std::int64_t key = map.key;
  {
    Query row(
        connection,
        "SELECT robot, sensor, odometry_frame, started FROM session WHERE map = ? AND name = ?",
        key, session.name);
    if (row.next()) {
      const auto there = std::tuple(row.text(0), row.text(1), row.text(2), row.integer(3));
      const auto wanted =
          std::tie(session.robot, session.sensor, session.odometry_frame, session.started);
      if (there == wanted) return;
      if (there != std::tuple(std::string(), std::string(), std::string(), std::int64_t{0})) {
        throw Error(ErrorCode::kAlreadyExists,
                    "map " + map.info.name + " has a session '" + session.name +
                        "' with another robot, sensor, odometry frame or start; name this one "
                        "otherwise");
      }
    }
  }
  Query(connection,
        "INSERT INTO session (map, name, robot, sensor, odometry_frame, started) "
        "VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT (map, name) DO UPDATE SET robot = excluded.robot, "
        "sensor = excluded.sensor, odometry_frame = excluded.odometry_frame, "
        "started = excluded.started",
        key, session.name, session.robot, session.sensor, session.odometry_frame, session.started)
      .run();
}

JobId insert_job(SqlConnection& connection, const JobRecord& job) {
  Query row(connection,
            "INSERT INTO job (map, kind, request, state, scans_done, scans_total, cells_done, "
            "error_code, error_message, created, started, updated) "
            "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) RETURNING id",
            job.map, job.kind, job.request_json, std::string(to_string(job.state)), job.scans_done,
            job.scans_total, job.cells_done, job.error_code, job.error_message, job.created,
            job.started, job.updated);
  row.next();
  return {row.unsigned32(0)};
}

void replace_job(SqlConnection& connection, const JobRecord& job) {
  const JobRecord before = read_job(connection, job.id);
  if (before.map != job.map || before.kind != job.kind) {
    throw Error(ErrorCode::kConflict,
                "job " + std::to_string(job.id.value) + ": its map and kind cannot change");
  }
  Query(connection,
        "UPDATE job SET state = ?, scans_done = ?, scans_total = ?, cells_done = ?, "
        "error_code = ?, error_message = ?, started = ?, updated = ? WHERE id = ?",
        std::string(to_string(job.state)), job.scans_done, job.scans_total, job.cells_done,
        job.error_code, job.error_message, job.started, job.updated, job.id.value)
      .run();
  if (is_final(job.state)) remove_parts(connection, job.id);
}

}  // namespace cellmap
