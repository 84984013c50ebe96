#include "cellmap/store/store_rules.hpp"

#include <vector>

namespace cellmap {
namespace {

using Rules = std::vector<StoreRule>;

/// Rows of a table that name a map or CELL that is not there.
StoreRule reference(const std::string& table, const char* what, const std::string& target,
                    const char* lost) {
  const std::string condition = "NOT EXISTS (SELECT 1 FROM " + target + ")";
  return {StoreDamage::kReference, what,
          "SELECT map, NULL, NULL FROM " + table + " WHERE " + condition,
          "DELETE FROM " + table + " WHERE " + condition, lost};
}

Rules reference_rules() {
  const auto map_of = [](const std::string& table) { return "map WHERE id = " + table + ".map"; };
  const auto cell_of = [](const std::string& table, const std::string& column) {
    return "cell WHERE cell.map = " + table + ".map AND cell.id = " + table + "." + column;
  };
  return {
      reference("cell", "a CELL of a map that is not there", map_of("cell"), "CELLs without a map"),
      reference("cell_pose", "a pose of a CELL that is not there", cell_of("cell_pose", "cell"),
                "poses without a CELL"),
      reference("cell_scans", "scans of a CELL that is not there", cell_of("cell_scans", "cell"),
                "stretches of scans without a CELL"),
      reference("cell_description", "a description of a CELL that is not there",
                cell_of("cell_description", "cell"), "descriptions without a CELL"),
      reference("pose_constraint", "a constraint from a CELL that is not there",
                cell_of("pose_constraint", "from_cell"), "constraints from no CELL"),
      reference("pose_constraint", "a constraint to a CELL that is not there",
                cell_of("pose_constraint", "to_cell"), "constraints to no CELL"),
      reference("session", "a session of a map that is not there", map_of("session"),
                "sessions without a map"),
      reference("document", "a document of a map that is not there", map_of("document"),
                "documents without a map"),
  };
}

Rules pose_rules() {
  const std::string last =
      "cell_pose AS p WHERE p.map = cell.map AND p.cell = cell.id AND p.revision = cell.moved";
  const std::string is_last = "NOT EXISTS (SELECT 1 FROM " + last +
                              " AND p.x = cell.x AND p.y = cell.y AND p.z = cell.z "
                              "AND p.rotation = cell.rotation)";
  const std::string no_first =
      "NOT EXISTS (SELECT 1 FROM cell_pose AS p WHERE p.map = cell.map AND p.cell = cell.id "
      "AND p.revision = cell.added)";
  return {
      {StoreDamage::kPose, "its present pose is not the last of its history",
       "SELECT map, id, NULL FROM cell WHERE " + is_last,
       "INSERT OR REPLACE INTO cell_pose (map, cell, revision, x, y, z, rotation) "
       "SELECT map, id, moved, x, y, z, rotation FROM cell WHERE " +
           is_last,
       nullptr},
      {StoreDamage::kPose, "the pose that it came with is missing",
       "SELECT map, id, NULL FROM cell WHERE " + no_first,
       "INSERT INTO cell_pose (map, cell, revision, x, y, z, rotation) "
       "SELECT cell.map, cell.id, cell.added, q.x, q.y, q.z, q.rotation FROM cell JOIN cell_pose "
       "AS q ON q.map = cell.map AND q.cell = cell.id AND q.revision = (SELECT MIN(revision) FROM "
       "cell_pose WHERE map = cell.map AND cell = cell.id) WHERE " +
           no_first,
       "poses that CELLs came with; the oldest known ones stand for them"},
  };
}

Rules drive_rules() {
  const std::string no_session =
      "NOT EXISTS (SELECT 1 FROM session AS s WHERE s.map = cell.map AND s.name = cell.session)";
  return {
      {StoreDamage::kDrive, "its session is not listed",
       "SELECT map, id, session FROM cell WHERE " + no_session,
       "INSERT INTO session (map, name, aligned) SELECT DISTINCT map, session, 0 FROM cell WHERE " +
           no_session,
       "descriptions of sessions, which count as aligned now"},
      {StoreDamage::kDrive, "its scans are missing",
       "SELECT map, id, NULL FROM cell WHERE NOT EXISTS (SELECT 1 FROM cell_scans AS s "
       "WHERE s.map = cell.map AND s.cell = cell.id)",
       "", "stretches of scans"},
  };
}

Rules map_rules() {
  const std::string newest =
      "(SELECT MAX(r) FROM (SELECT MAX(moved) AS r FROM cell WHERE map = map.id "
      "UNION ALL SELECT MAX(added) FROM cell WHERE map = map.id "
      "UNION ALL SELECT MAX(revision) FROM cell_pose WHERE map = map.id "
      "UNION ALL SELECT MAX(added) FROM pose_constraint WHERE map = map.id "
      "UNION ALL SELECT MAX(removed) FROM pose_constraint WHERE map = map.id "
      "UNION ALL SELECT MAX(judged) FROM pose_constraint WHERE map = map.id))";
  Rules rules = {{StoreDamage::kRevision, "something in it is of a revision to come",
                  "SELECT id, NULL, NULL FROM map WHERE revision < " + newest,
                  "UPDATE map SET revision = " + newest + " WHERE revision < " + newest, nullptr}};
  const std::pair<const char*, const char*> kSums[] = {
      {"cells", "(SELECT COUNT(*) FROM cell WHERE cell.map = map.id)"},
      {"planes", "(SELECT COALESCE(SUM(cell.planes), 0) FROM cell WHERE cell.map = map.id)"},
      {"constraints",
       "(SELECT COUNT(*) FROM pose_constraint AS c WHERE c.map = map.id AND c.removed IS NULL)"},
  };
  for (const auto& [column, sum] : kSums) {
    const std::string name = column;
    rules.push_back({StoreDamage::kCount, "a sum that it keeps is wrong",
                     "SELECT id, NULL, '" + name + "' FROM map WHERE " + name + " <> " + sum,
                     "UPDATE map SET " + name + " = " + sum + " WHERE " + name + " <> " + sum,
                     nullptr});
  }
  rules.push_back(
      {StoreDamage::kUnused, "contents that no CELL has",
       "SELECT NULL, NULL, hex(hash) FROM blob WHERE NOT EXISTS (SELECT 1 FROM cell WHERE "
       "cell.hash = blob.hash)",
       "DELETE FROM blob WHERE NOT EXISTS (SELECT 1 FROM cell WHERE cell.hash = blob.hash)",
       "contents that no CELL had"});
  return rules;
}

}  // namespace

std::vector<StoreRule> store_rules() {
  Rules rules = reference_rules();
  for (const Rules& part : {drive_rules(), pose_rules(), map_rules()}) {
    rules.insert(rules.end(), part.begin(), part.end());
  }
  return rules;
}

}  // namespace cellmap
