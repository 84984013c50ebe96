#include "cellmap/store/sql_update.hpp"

#include <algorithm>
#include <limits>

#include "cellmap/store/row_codec.hpp"
#include "cellmap/store/sql_cells.hpp"
#include "cellmap/store/sql_contents.hpp"
#include "cellmap/store/sql_remove_session.hpp"
#include "cellmap/store/sql_schema.hpp"
#include "cellmap/store/update_context.hpp"

namespace cellmap {
namespace {

/// The bytes that are kept of a CELL, and what the tables say of them.
struct Kept {
  Kept(const EncodedCell& encoded, const std::optional<CodedCopy>& coded)
      : content(coded ? coded->content : encoded),
        form(coded ? coded->form : CellForm{}),
        identity(coded ? std::optional(to_bytes(encoded.hash)) : std::nullopt),
        source(coded ? std::optional(to_bytes(coded->source)) : std::nullopt) {}

  std::uint32_t encoding() const { return static_cast<std::uint32_t>(form.encoding); }

  const EncodedCell& content;
  CellForm form;
  std::optional<Bytes> identity, source;
};

/// One update on its way into the tables.
class Update {
 public:
  Update(SqlConnection& connection, const MapRow& map, bool are_objects)
      : connection_(connection),
        are_objects_(are_objects),
        map_(map),
        revision_(map_.info.revision + 1) {}

  const MapInfo& info() const { return map_.info; }
  /// Before all but `remove_session`.
  void prepare(const MapUpdate& update, const UpdateFrames& frames);

  void add_cell(const NewCell& cell, const Bytes& frame);
  void recode_cell(CellId id, const RecodedCell& recoded, const Bytes& frame);
  void move_cell(CellId id, const Pose& T_map_cell);
  void align(CellId id);
  void remove_constraint(ConstraintId id);
  ConstraintId add_constraint(const Constraint& constraint);
  void judge(ConstraintId id, const Judgement& judgement);
  void remove_session(const std::string& name) {
    left_.merge(cellmap::remove_session(connection_, map_, name));
    map_.oldest = revision_;
    changed_ = true;
  }
  /// Writes the map's row; returns its revision.
  Revision finish();

 private:
  bool is_there_already(const NewCell& cell) const;
  void remember(const NewCell& cell, const Bytes& frame);
  void begin_session(const NewCell& first);
  void need_content(CellId id, const EncodedCell& content, const Bytes& frame);
  void insert_cell(const NewCell& cell);
  void insert_pose(CellId id, const Pose& T_map_cell);
  CellRecord& require_cell(CellId id);
  Judgement& require_constraint(ConstraintId id);

  SqlConnection& connection_;
  const bool are_objects_;
  MapRow map_;
  const Revision revision_;
  UpdateContext context_;
  std::map<ContentHash, NewContent> needed_;  ///< by CELLs that are added or recoded
  std::set<ContentHash> left_;                ///< by CELLs that are removed or recoded
  bool changed_ = false;
};

void Update::prepare(const MapUpdate& update, const UpdateFrames& frames) {
  context_ = read_update_context(connection_, map_.key, update);
  for (std::size_t i = 0; i < update.cells.size(); ++i) {
    const NewCell& cell = update.cells[i];
    if (context_.cells.contains(cell.id)) continue;
    const EncodedCell& content = Kept(cell.encoded, cell.coded).content;
    need_content(cell.id, content, frames.cells[i]);
    if (update.recoded.contains(cell.id)) left_.insert(content.hash);
  }
  auto frame = frames.recoded.begin();
  for (const auto& [id, recoded] : update.recoded) {
    need_content(id, Kept(recoded.encoded, recoded.coded).content, *frame++);
    if (const auto before = context_.kept.find(id); before != context_.kept.end()) {
      left_.insert(before->second.hash);
    }
  }
  hold_contents(connection_, needed_, context_.contents, left_);
}

void Update::need_content(CellId id, const EncodedCell& content, const Bytes& frame) {
  const NewContent wanted{content.bytes.size(), &frame, are_objects_};
  const auto same = needed_.emplace(content.hash, wanted).first;
  const auto there = context_.contents.find(content.hash);
  if (same->second.encoded_bytes != wanted.encoded_bytes ||
      (there != context_.contents.end() && there->second != wanted.encoded_bytes)) {
    throw Error(ErrorCode::kInvalidArgument,
                "CELL " + std::to_string(id.value) + ": its hash is that of other bytes");
  }
}

void Update::add_cell(const NewCell& cell, const Bytes& frame) {
  if (cell.cell->lattice != map_.info.lattice) {
    throw Error(ErrorCode::kInvalidArgument,
                "CELL " + std::to_string(cell.id.value) +
                    " was made with another lattice than that of map " + map_.info.name +
                    "; build it with the map's lattice");
  }
  if (is_there_already(cell)) return;
  if (!context_.sessions.contains(cell.cell->session)) begin_session(cell);
  insert_cell(cell);
  insert_pose(cell.id, cell.T_map_cell);
  Query(connection_, "INSERT INTO cell_scans (map, cell, T_odom_cell, scans) VALUES (?, ?, ?, ?)",
        map_.key, cell.id.value, pose_to_bytes(cell.cell->T_odom_cell), scans_to_bytes(cell.scans))
      .run();
  MapInfo& info = map_.info;
  info.cells += 1;
  info.planes += cell.cell->planes.size();
  info.encoded_bytes += cell.encoded.bytes.size();
  info.stored_bytes += frame.size();
  info.scans += cell.scans.size();
  info.raw_points += cell.raw_points;
  info.voxel_points += cell.voxel_points;
  remember(cell, frame);
  changed_ = true;
}

/// For what else the update says of it.
void Update::remember(const NewCell& cell, const Bytes& frame) {
  const auto& [session, sequence] = std::tie(cell.cell->session, cell.cell->sequence);
  const Kept kept(cell.encoded, cell.coded);
  CellRecord& record = context_.cells[cell.id];
  record.hash = cell.encoded.hash;
  record.session = session;
  record.encoded_bytes = cell.encoded.bytes.size();
  record.T_map_cell = cell.T_map_cell;
  context_.kept[cell.id] = {kept.content.hash, frame.size()};
  context_.places.emplace(std::pair(session, sequence), cell.id);
  context_.sessions.insert(session);
}

bool Update::is_there_already(const NewCell& cell) const {
  if (const auto same_id = context_.cells.find(cell.id); same_id != context_.cells.end()) {
    if (same_id->second.hash == cell.encoded.hash) return true;
    throw Error(ErrorCode::kConflict, "map " + map_.info.name + " has a CELL " +
                                          std::to_string(cell.id.value) +
                                          " with other content; CELLs never change");
  }
  const auto& [session, sequence] = std::tie(cell.cell->session, cell.cell->sequence);
  if (const auto same_place = context_.places.find({session, sequence});
      same_place != context_.places.end()) {
    throw Error(ErrorCode::kConflict, "map " + map_.info.name + " has session " + session +
                                          ", sequence " + std::to_string(sequence) +
                                          " already as CELL " +
                                          std::to_string(same_place->second.value));
  }
  return false;
}

/// The session may be there without CELLs.
void Update::begin_session(const NewCell& first) {
  const std::optional<Revision> aligned =
      first.unaligned ? std::nullopt : std::optional<Revision>(revision_);
  Query(connection_,
        "INSERT INTO session (map, name, aligned) VALUES (?, ?, ?) "
        "ON CONFLICT (map, name) DO UPDATE SET aligned = excluded.aligned",
        map_.key, first.cell->session, aligned)
      .run();
}

void Update::align(CellId id) {
  const CellRecord& cell = require_cell(id);
  Query(connection_,
        "UPDATE session SET aligned = ? WHERE map = ? AND name = ? AND aligned IS NULL", revision_,
        map_.key, cell.session)
      .run();
  changed_ = true;
}

void Update::insert_cell(const NewCell& cell) {
  const Eigen::Vector3d& position = cell.T_map_cell.translation();
  const Kept kept(cell.encoded, cell.coded);
  Query(connection_,
        "INSERT INTO cell (map, id, hash, session, sequence, planes, encoded_bytes, added, moved, "
        "x, y, z, rotation, gx, gy, scans, raw_points, voxel_points, encoding, bound_um, identity, "
        "source) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        map_.key, cell.id.value, to_bytes(kept.content.hash), cell.cell->session,
        cell.cell->sequence, cell.cell->planes.size(), cell.encoded.bytes.size(), revision_,
        revision_, position.x(), position.y(), position.z(), rotation_to_bytes(cell.T_map_cell),
        grid_key(position.x()), grid_key(position.y()), cell.scans.size(), cell.raw_points,
        cell.voxel_points, kept.encoding(), kept.form.bound_um, kept.identity, kept.source)
      .run();
}

void Update::recode_cell(CellId id, const RecodedCell& recoded, const Bytes& frame) {
  CellRecord& cell = require_cell(id);
  if (cell.hash != recoded.from) {
    throw Error(ErrorCode::kPreconditionFailed,
                "CELL " + std::to_string(id.value) + " of map " + map_.info.name +
                    " has another content by now; read it again and repeat");
  }
  const Kept kept(recoded.encoded, recoded.coded);
  const UpdateContext::Kept before = context_.kept[id];
  Query(connection_,
        "UPDATE cell SET hash = ?, encoded_bytes = ?, encoding = ?, bound_um = ?, identity = ?, "
        "source = ? WHERE map = ? AND id = ?",
        to_bytes(kept.content.hash), recoded.encoded.bytes.size(), kept.encoding(),
        kept.form.bound_um, kept.identity, kept.source, map_.key, id.value)
      .run();
  if (recoded.encoded.hash != recoded.from) {
    Query(connection_, "UPDATE cell SET replaced = ?, moved = ? WHERE map = ? AND id = ?",
          revision_, revision_, map_.key, id.value)
        .run();
    insert_pose(id, cell.T_map_cell);  // `moved` names a row of the history
  }
  MapInfo& info = map_.info;
  info.stored_bytes -= std::min(info.stored_bytes, before.frame_bytes);
  info.stored_bytes += frame.size();
  info.encoded_bytes += recoded.encoded.bytes.size();
  info.encoded_bytes -= std::min(info.encoded_bytes, cell.encoded_bytes);
  cell.hash = recoded.encoded.hash;
  cell.encoded_bytes = recoded.encoded.bytes.size();
  changed_ = true;
}

void Update::insert_pose(CellId id, const Pose& T_map_cell) {
  const Eigen::Vector3d& position = T_map_cell.translation();
  // A CELL may be added and moved by one update; the last pose counts.
  Query(
      connection_,
      "INSERT INTO cell_pose (map, cell, revision, x, y, z, rotation) VALUES (?, ?, ?, ?, ?, ?, ?) "
      "ON CONFLICT (map, cell, revision) DO UPDATE SET x = excluded.x, y = excluded.y, "
      "z = excluded.z, rotation = excluded.rotation",
      map_.key, id.value, revision_, position.x(), position.y(), position.z(),
      rotation_to_bytes(T_map_cell))
      .run();
}

void Update::move_cell(CellId id, const Pose& T_map_cell) {
  CellRecord& cell = require_cell(id);
  if (cell.T_map_cell.matrix() == T_map_cell.matrix()) return;
  const Eigen::Vector3d& position = T_map_cell.translation();
  Query(connection_,
        "UPDATE cell SET moved = ?, x = ?, y = ?, z = ?, rotation = ?, gx = ?, gy = ? "
        "WHERE map = ? AND id = ?",
        revision_, position.x(), position.y(), position.z(), rotation_to_bytes(T_map_cell),
        grid_key(position.x()), grid_key(position.y()), map_.key, id.value)
      .run();
  insert_pose(id, T_map_cell);
  cell.T_map_cell = T_map_cell;
  changed_ = true;
}

CellRecord& Update::require_cell(CellId id) {
  const auto found = context_.cells.find(id);
  if (found != context_.cells.end()) return found->second;
  throw Error(ErrorCode::kNotFound,
              "map " + map_.info.name + " has no CELL " + std::to_string(id.value));
}

Judgement& Update::require_constraint(ConstraintId id) {
  const auto found = context_.constraints.find(id);
  if (found != context_.constraints.end()) return found->second;
  throw Error(ErrorCode::kNotFound,
              "map " + map_.info.name + " has no constraint " + std::to_string(id.value));
}

void Update::remove_constraint(ConstraintId id) {
  require_constraint(id);
  Query(connection_, "UPDATE pose_constraint SET removed = ? WHERE map = ? AND id = ?", revision_,
        map_.key, id.value)
      .run();
  context_.constraints.erase(id);
  map_.info.constraints -= 1;
  changed_ = true;
}

ConstraintId Update::add_constraint(const Constraint& constraint) {
  require_cell(constraint.from);
  require_cell(constraint.to);
  const UpdateContext::Likeness like = UpdateContext::likeness(constraint);
  const auto alike = context_.alike.find(like);
  if (alike != context_.alike.end()) return alike->second;
  if (map_.next_constraint == std::numeric_limits<std::uint32_t>::max()) {
    throw Error(ErrorCode::kTooLarge, "map " + map_.info.name + " has used up its constraint ids");
  }
  const ConstraintId id{map_.next_constraint++};
  Query(connection_,
        "INSERT INTO pose_constraint (map, id, added, from_cell, to_cell, kind, origin, T_from_to, "
        "information, scores, weight, pinned) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
        map_.key, id.value, revision_, like.from.value, like.to.value, like.kind, like.origin,
        like.T_from_to, like.information, scores_to_bytes(constraint.scores), constraint.weight,
        constraint.pinned ? 1u : 0u)
      .run();
  context_.alike.emplace(like, id);
  map_.info.constraints += 1;
  changed_ = true;
  return id;
}

void Update::judge(ConstraintId id, const Judgement& judgement) {
  if (require_constraint(id) == judgement) return;
  Query(connection_,
        "UPDATE pose_constraint SET weight = ?, pinned = ?, judged = ? WHERE map = ? AND id = ?",
        judgement.weight, judgement.pinned ? 1u : 0u, revision_, map_.key, id.value)
      .run();
  changed_ = true;
}

Revision Update::finish() {
  if (!changed_) return map_.info.revision;
  remove_unused_contents(connection_, left_);
  const MapInfo& info = map_.info;
  Query(connection_,
        "UPDATE map SET revision = ?, next_constraint = ?, cells = ?, planes = ?, constraints = ?, "
        "encoded_bytes = ?, stored_bytes = ?, scans = ?, raw_points = ?, voxel_points = ?, "
        "next_cell = ?, oldest = ? WHERE id = ?",
        revision_, map_.next_constraint, info.cells, info.planes, info.constraints,
        info.encoded_bytes, info.stored_bytes, info.scans, info.raw_points, info.voxel_points,
        map_.next_cell.value, map_.oldest, map_.key)
      .run();
  return revision_;
}

}  // namespace

CommitResult apply_update(SqlConnection& connection, const MapRow& map, const MapUpdate& update,
                          const UpdateFrames& frames) {
  Update writer(connection, map, frames.are_objects);
  if (update.expected_revision && *update.expected_revision != writer.info().revision) {
    throw Error(ErrorCode::kPreconditionFailed,
                "map " + map.info.name + " is at revision " +
                    std::to_string(writer.info().revision) + ", not at the expected " +
                    std::to_string(*update.expected_revision) + "; read it again and repeat");
  }
  for (const std::string& session : update.remove_sessions) writer.remove_session(session);
  writer.prepare(update, frames);
  for (std::size_t i = 0; i < update.cells.size(); ++i) {
    writer.add_cell(update.cells[i], frames.cells[i]);
  }
  auto frame = frames.recoded.begin();
  for (const auto& [id, recoded] : update.recoded) writer.recode_cell(id, recoded, *frame++);
  for (const auto& [id, T_map_cell] : update.poses) writer.move_cell(id, T_map_cell);
  for (const CellId id : update.aligned) writer.align(id);
  for (const ConstraintId id : update.remove_constraints) writer.remove_constraint(id);
  for (const auto& [id, judgement] : update.judged) writer.judge(id, judgement);
  CommitResult result;
  for (const Constraint& constraint : update.add_constraints) {
    result.constraint_ids.push_back(writer.add_constraint(constraint));
  }
  result.revision = writer.finish();
  return result;
}

}  // namespace cellmap
