#include "cellmap/client/json_reading.hpp"

// Maps, CELLs, sessions, changes.

namespace cellmap::client {
namespace {

Eigen::Vector3d vector3_from(const Json& json) {
  const auto v = numbers<3>(json);
  return {v[0], v[1], v[2]};
}

LatticeSpec lattice_from(const Json& json) {
  return {lattice_kind_from(json.at("kind").get<std::string>()),
          integer<std::uint32_t>(json.at("size"))};
}

Georeference georeference_from(const Json& json) {
  const auto q = numbers<4>(json.at("q_enu_map"));
  const std::array<double, 7> pose = {0, 0, 0, q[0], q[1], q[2], q[3]};
  return {json.at("latitude_deg").get<double>(), json.at("longitude_deg").get<double>(),
          json.at("height_m").get<double>(), pose_from_xyz_qxyzw(pose).linear()};
}

}  // namespace

void put_form(Json& json, const CellForm& form) {
  json["encoding"] = to_string(form.encoding);
  if (!form.is_exact()) json["bound_m"] = form.bound_m();
}

CellForm form_from_json(const Json& json) {
  return decoded("form of CELLs", [&] {
    const double bound_m = json.value("bound_m", 0.0);
    return cell_form(json.at("encoding").get<std::string>(),
                     bound_m > 0 ? std::optional(bound_m) : std::nullopt);
  });
}

MapInfo map_info_from_json(const Json& json) {
  return decoded("map summary", [&] {
    MapInfo map;
    map.name = json.at("name");
    map.lattice = lattice_from(json.at("lattice"));
    map.revision = count(json, "revision");
    map.created = stamp_from_rfc3339(json.at("created"));
    map.cells = count(json, "cells");
    map.planes = count(json, "planes");
    map.constraints = count(json, "constraints");
    map.encoded_bytes = count(json, "encoded_bytes");
    map.stored_bytes = count(json, "stored_bytes");
    map.scans = count(json, "scans");
    map.raw_points = count(json, "raw_points");
    map.voxel_points = count(json, "voxel_points");
    if (const Json& bounds = json.at("bounds"); !bounds.is_null()) {
      map.bounds.extend(vector3_from(bounds.at("min")));
      map.bounds.extend(vector3_from(bounds.at("max")));
    }
    map.sessions = json.at("sessions").get<std::vector<std::string>>();
    if (const Json where = json.value("georeference", Json()); !where.is_null()) {
      map.georeference = georeference_from(where);
    }
    if (json.contains("encoding")) map.form = form_from_json(json);  // newer servers say it
    for (const Json& kept : json.value("kept", Json::array())) {
      map.kept[form_from_json(kept)] = count(kept, "cells");
    }
    return map;
  });
}

CellRecord cell_record_from_json(const Json& json) {
  return decoded("CELL summary", [&] {
    CellRecord cell;
    cell.id = id<CellId>(json.at("id"));
    cell.hash = content_hash_from_hex(json.at("hash"));
    cell.added = count(json, "added");
    cell.moved = count(json, "moved");
    cell.T_map_cell = pose_from_json(json.at("pose"));
    cell.session = json.at("session");
    cell.sequence = integer<std::uint32_t>(json.at("sequence"));
    cell.planes = integer<std::uint32_t>(json.at("planes"));
    cell.encoded_bytes = count(json, "bytes");
    return cell;
  });
}

Json to_json(const CellPage& page) {
  Json cells = Json::array();
  for (const CellRecord& cell : page.cells) cells.push_back(to_json(cell));
  return {{"revision", page.revision},
          {"cells", cells},
          {"next_cursor", page.next_cursor.empty() ? Json(nullptr) : Json(page.next_cursor)}};
}

CellPage cell_page_from_json(const Json& json) {
  return decoded("list of CELLs", [&] {
    CellPage page;
    page.revision = count(json, "revision");
    page.cells = list_of<CellRecord>(json.at("cells"), cell_record_from_json);
    if (!json.at("next_cursor").is_null()) page.next_cursor = json.at("next_cursor");
    return page;
  });
}

PutCellResult put_cell_result_from_json(const Json& json) {
  return decoded("CELL summary", [&] {
    return PutCellResult{cell_record_from_json(json), count(json, "revision"), false};
  });
}

Json to_json(const Session& session) {
  return {{"name", session.name},
          {"robot", session.robot},
          {"sensor", session.sensor},
          {"odometry_frame", session.odometry_frame},
          {"started", session.started > 0 ? Json(to_rfc3339(session.started)) : Json()},
          {"cells", session.cells},
          {"planes", session.planes},
          {"encoded_bytes", session.encoded_bytes},
          {"aligned", session.aligned},
          {"last_cell", session.last_cell ? Json(session.last_cell->value) : Json()},
          {"T_map_odom", session.T_map_odom ? to_json(*session.T_map_odom) : Json()}};
}

Session session_from_json(const Json& json) {
  return decoded("session", [&] {
    Session session;
    session.name = json.at("name");
    session.robot = json.at("robot");
    session.sensor = json.at("sensor");
    session.odometry_frame = json.at("odometry_frame");
    if (!json.at("started").is_null()) session.started = stamp_from_rfc3339(json.at("started"));
    session.aligned = json.at("aligned");
    session.cells = count(json, "cells");
    session.planes = count(json, "planes");
    session.encoded_bytes = count(json, "encoded_bytes");
    if (!json.at("last_cell").is_null()) session.last_cell = id<CellId>(json.at("last_cell"));
    if (!json.at("T_map_odom").is_null()) {
      session.T_map_odom = pose_from_json(json.at("T_map_odom"));
    }
    return session;
  });
}

SessionCell session_cell_from_json(const Json& json) {
  return decoded("CELL of a session", [&] {
    return SessionCell{put_cell_result_from_json(json), json.at("aligned").get<bool>()};
  });
}

ContentHash content_hash_from_json(const Json& json) {
  return decoded("content hash", [&] { return content_hash_from_hex(json); });
}

Changes changes_from_json(const Json& json) {
  return decoded("list of changes", [&] {
    Changes changes;
    changes.since = count(json, "since");
    changes.revision = count(json, "revision");
    changes.added = list_of<CellRecord>(json.at("added"), cell_record_from_json);
    for (const Json& moved : json.at("moved")) {
      changes.moved[id<CellId>(moved.at("id"))] = pose_from_json(moved.at("pose"));
    }
    changes.removed = list_of<CellId>(json.at("removed"), id<CellId>);
    for (const CellId cell : list_of<CellId>(json.value("unaligned", Json::array()), id<CellId>)) {
      changes.unaligned.insert(cell);
    }
    changes.added_constraints =
        list_of<Constraint>(json.at("added_constraints"), constraint_from_json);
    changes.removed_constraints =
        list_of<ConstraintId>(json.at("removed_constraints"), id<ConstraintId>);
    for (const Json& judged : json.value("judged", Json::array())) {
      changes.judged[id<ConstraintId>(judged.at("id"))] = {judged.at("weight").get<double>(),
                                                           judged.at("pinned").get<bool>()};
    }
    return changes;
  });
}

RevisionEvent revision_event_from_json(const Json& json) {
  return decoded("event of a revision", [&] {
    return RevisionEvent{count(json, "revision"), stamp_from_rfc3339(json.at("created"))};
  });
}

}  // namespace cellmap::client
