#include "cellmap/codec/changes_codec.hpp"

#include <cstring>
#include <string>

#include "cellmap/codec/byte_planes.hpp"
#include "cellmap/codec/constraint_wire.hpp"
#include "cellmap/codec/pose_grid.hpp"
#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/changes_generated.h"

namespace cellmap {
namespace {

constexpr BufferKind kChangesKind = {
    "list of changes", "CCHG", kMaxChangesBytes,
    [](flatbuffers::Verifier& v) { return schema::VerifyChangesBuffer(v); }};

/// An added CELL with storage of its own takes more bytes than this (its hash and its pose alone).
constexpr std::size_t kMinAddedCellBytes = 128;
static_assert(kMinAddedCellBytes < kMinConstraintBytes);

/// Columns of grid coordinates, in the order of the schema.
constexpr int kCoordinates = 6;
constexpr const char* kColumnNames[kCoordinates] = {"x", "y", "z", "rx", "ry", "rz"};

Error corrupt_changes(const std::string& what) {
  return Error(ErrorCode::kCorruptData, "these changes are not valid: " + what);
}

Error too_many(std::size_t count) {
  return Error(ErrorCode::kTooLarge, "changes name at most " + std::to_string(kMaxIdsInChanges) +
                                         " CELLs or constraints in one list, but " +
                                         std::to_string(count) +
                                         " were given; ask for the pose graph instead");
}

template <typename Ids>
void check_increasing(const Ids& ids, const char* name) {
  for (std::size_t i = 1; i < ids.size(); ++i) {
    if (ids[i - 1] < ids[i]) continue;
    throw corrupt_changes(std::string(name) + " " + std::to_string(ids[i].value) + " follows " +
                          std::to_string(ids[i - 1].value) + ", but ids increase");
  }
}

void check_added(const MapChanges& changes) {
  std::vector<CellId> ids;
  for (const CellRecord& cell : changes.added) {
    ids.push_back(cell.id);
    const std::string name = "the added CELL " + std::to_string(cell.id.value);
    if (!is_session_name(cell.session)) {
      throw corrupt_changes(name + " has no session of 1 to 64 characters of A-Z a-z 0-9 . _ -");
    }
    if (cell.added <= changes.since || cell.moved < cell.added || cell.moved > changes.revision) {
      throw corrupt_changes(name + " was not added after " + std::to_string(changes.since) +
                            " and last moved by " + std::to_string(changes.revision));
    }
    if (!is_rigid(cell.T_map_cell)) {
      throw corrupt_changes("the pose of " + name + " is not a rigid transform of finite numbers");
    }
    if (changes.moved.contains(cell.id))
      throw corrupt_changes(name + " is among the moved ones too");
  }
  check_increasing(ids, "the added CELL");
}

/// The rules of FORMAT.md, "Changes", on everything but the columns of moved CELLs.
void check_changes(const MapChanges& changes) {
  if (changes.revision < changes.since) {
    throw corrupt_changes("revision " + std::to_string(changes.revision) + " is before revision " +
                          std::to_string(changes.since) + ", from which they lead on");
  }
  for (const std::size_t count :
       {changes.moved.size(), changes.unaligned.size(), changes.removed.size(),
        changes.removed_constraints.size(), changes.judged.size()}) {
    if (count > kMaxIdsInChanges) throw too_many(count);
  }
  check_added(changes);
  check_increasing(changes.removed, "the removed CELL");
  check_increasing(changes.removed_constraints, "the removed constraint");
  std::vector<ConstraintId> ids;
  for (const Constraint& constraint : changes.added_constraints) {
    check_constraint(constraint);
    if (constraint.id.value == 0) throw corrupt_changes("an added constraint has no number");
    if (changes.judged.contains(constraint.id)) {
      throw corrupt_changes("the added constraint " + std::to_string(constraint.id.value) +
                            " is among the judged ones too");
    }
    ids.push_back(constraint.id);
  }
  check_increasing(ids, "the added constraint");
  for (const auto& [id, judgement] : changes.judged) {
    if (id.value == 0) throw corrupt_changes("a judged constraint has no number");
    check_weight(judgement.weight);
  }
}

std::int64_t& coordinate(GridPose& pose, int column) {
  return column < 3 ? pose.translation[column] : pose.rotation[column - 3];
}

using Builder = flatbuffers::FlatBufferBuilder;
using WireBytes = flatbuffers::Offset<flatbuffers::Vector<std::uint8_t>>;

WireBytes column_to_wire(Builder& builder, const std::vector<std::int64_t>& values) {
  const Bytes bytes = encode_column(values);
  return builder.CreateVector(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
}

/// Null, and so absent, where there are none.
flatbuffers::Offset<schema::Ids> ids_to_wire(Builder& builder,
                                             const std::vector<std::int64_t>& ids) {
  if (ids.empty()) return 0;
  const WireBytes column = column_to_wire(builder, ids);
  return schema::CreateIds(builder, static_cast<std::uint32_t>(ids.size()), column);
}

template <typename Ids>
std::vector<std::int64_t> values_of(const Ids& ids) {
  std::vector<std::int64_t> values;
  for (const auto id : ids) values.push_back(id.value);
  return values;
}

std::span<const std::byte> bytes_of(const flatbuffers::Vector<std::uint8_t>& wire) {
  return std::as_bytes(std::span(wire.Data(), wire.size()));
}

template <typename Id>
std::vector<Id> ids_from_wire(const schema::Ids* wire, const char* name) {
  std::vector<Id> ids;
  if (!wire) return ids;
  const std::size_t count = wire->count();
  const auto bytes = bytes_of(*wire->ids());
  if (count > kMaxIdsInChanges) throw too_many(count);
  // Ids increase, so only the column of id 0 alone has no bytes: what is allocated is bounded.
  if (count == 0 || count > bytes.size() + 1) {
    throw corrupt_changes(std::string("the column '") + name + "' of " + std::to_string(count) +
                          " ids has " + std::to_string(bytes.size()) + " bytes");
  }
  std::int64_t last = -1;
  for (const std::int64_t id : decode_column(bytes, count, name)) {
    if (id <= last || id > UINT32_MAX) {
      throw corrupt_changes(std::string("the ids of '") + name +
                            "' do not increase from 0 to 4294967295");
    }
    ids.push_back(Id{static_cast<std::uint32_t>(id)});
    last = id;
  }
  return ids;
}

flatbuffers::Offset<schema::MovedCells> moved_to_wire(Builder& builder,
                                                      const std::map<CellId, Pose>& moved) {
  if (moved.empty()) return 0;
  std::vector<std::int64_t> cells, values[kCoordinates];
  for (const auto& [id, pose] : moved) {
    cells.push_back(id.value);
    GridPose grid = to_grid(pose);
    for (int i = 0; i < kCoordinates; ++i) values[i].push_back(coordinate(grid, i));
  }
  const auto wire_cells = ids_to_wire(builder, cells);
  WireBytes columns[kCoordinates];
  for (int i = 0; i < kCoordinates; ++i) columns[i] = column_to_wire(builder, values[i]);
  return schema::CreateMovedCells(builder, wire_cells, columns[0], columns[1], columns[2],
                                  columns[3], columns[4], columns[5]);
}

std::map<CellId, Pose> moved_from_wire(const schema::MovedCells& wire) {
  const auto cells = ids_from_wire<CellId>(wire.cells(), "cells");
  std::vector<GridPose> poses(cells.size());
  const flatbuffers::Vector<std::uint8_t>* const columns[kCoordinates] = {
      wire.x(), wire.y(), wire.z(), wire.rx(), wire.ry(), wire.rz()};
  for (int i = 0; i < kCoordinates; ++i) {
    const std::int64_t limit = i < 3 ? kMaxGridTranslation : kMaxGridRotation;
    const auto values = decode_column(bytes_of(*columns[i]), cells.size(), kColumnNames[i]);
    for (std::size_t row = 0; row < cells.size(); ++row) {
      if (values[row] < -limit || values[row] > limit) {
        throw corrupt_changes(std::string("a coordinate ") + kColumnNames[i] + " is " +
                              std::to_string(values[row]) + " steps, but at most " +
                              std::to_string(limit) + " are allowed");
      }
      coordinate(poses[row], i) = values[row];
    }
  }
  std::map<CellId, Pose> moved;
  for (std::size_t row = 0; row < cells.size(); ++row) {
    moved.emplace_hint(moved.end(), cells[row], from_grid(poses[row]));
  }
  return moved;
}

flatbuffers::Offset<schema::AddedCell> added_to_wire(Builder& builder, const CellRecord& cell) {
  const auto session = builder.CreateSharedString(cell.session);
  schema::Hash256 hash;
  static_assert(sizeof(hash) == sizeof(cell.hash.bytes));
  std::memcpy(static_cast<void*>(&hash), cell.hash.bytes.data(), sizeof(hash));
  const schema::Pose T_map_cell = pose_to_wire(cell.T_map_cell);
  return schema::CreateAddedCell(builder, cell.id.value, &hash, cell.added, cell.moved, &T_map_cell,
                                 session, cell.sequence, cell.planes, cell.encoded_bytes);
}

CellRecord added_from_wire(const schema::AddedCell& wire) {
  CellRecord cell;
  cell.id.value = wire.cell();
  std::memcpy(cell.hash.bytes.data(), static_cast<const void*>(wire.hash()),
              cell.hash.bytes.size());
  cell.added = wire.added();
  cell.moved = wire.moved();
  cell.T_map_cell = pose_from_wire(wire.t_map_cell(), "an added CELL's pose T_map_cell");
  if (wire.session()->size() <= 64) cell.session = wire.session()->str();  // else checked: empty
  cell.sequence = wire.sequence();
  cell.planes = wire.planes();
  cell.encoded_bytes = wire.encoded_bytes();
  return cell;
}

flatbuffers::Offset<schema::JudgedConstraints> judged_to_wire(
    Builder& builder, const std::map<ConstraintId, Judgement>& judged) {
  if (judged.empty()) return 0;
  std::vector<std::int64_t> ids;
  std::vector<double> weights;
  std::vector<std::uint8_t> pins;
  for (const auto& [id, judgement] : judged) {
    ids.push_back(id.value);
    weights.push_back(judgement.weight);
    pins.push_back(judgement.pinned);
  }
  const auto constraints = ids_to_wire(builder, ids);
  const auto weight = builder.CreateVector(weights);
  const auto pinned = builder.CreateVector(pins);
  return schema::CreateJudgedConstraints(builder, constraints, weight, pinned);
}

std::map<ConstraintId, Judgement> judged_from_wire(const schema::JudgedConstraints& wire) {
  const auto ids = ids_from_wire<ConstraintId>(wire.constraints(), "judged");
  if (wire.weight()->size() != ids.size() || wire.pinned()->size() != ids.size()) {
    throw corrupt_changes("the columns of judged constraints differ in length");
  }
  std::map<ConstraintId, Judgement> judged;
  for (flatbuffers::uoffset_t row = 0; row < ids.size(); ++row) {
    judged.emplace_hint(judged.end(), ids[row],
                        Judgement{wire.weight()->Get(row), wire.pinned()->Get(row) != 0});
  }
  return judged;
}

}  // namespace

Bytes encode_changes(const MapChanges& changes) {
  check_changes(changes);
  Builder builder(1024 + 24 * changes.moved.size() + 192 * changes.added.size() +
                  384 * changes.added_constraints.size());
  // The order of these lines is the order of the bytes: FORMAT.md, "How the library lays out".
  std::vector<flatbuffers::Offset<schema::AddedCell>> added;
  for (const CellRecord& cell : changes.added) added.push_back(added_to_wire(builder, cell));
  const auto wire_added = builder.CreateVector(added);
  const auto moved = moved_to_wire(builder, changes.moved);
  const auto removed = ids_to_wire(builder, values_of(changes.removed));
  std::vector<flatbuffers::Offset<schema::Constraint>> constraints;
  for (const Constraint& constraint : changes.added_constraints) {
    constraints.push_back(constraint_to_wire(builder, constraint));
  }
  const auto wire_constraints = builder.CreateVector(constraints);
  const auto removed_constraints = ids_to_wire(builder, values_of(changes.removed_constraints));
  const auto unaligned = ids_to_wire(builder, values_of(changes.unaligned));
  const auto judged = judged_to_wire(builder, changes.judged);
  schema::FinishChangesBuffer(
      builder, schema::CreateChanges(builder, kFormatVersion, changes.since, changes.revision,
                                     wire_added, moved, removed, wire_constraints,
                                     removed_constraints, unaligned, judged));
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  return Bytes(begin, begin + builder.GetSize());
}

MapChanges decode_changes(std::span<const std::byte> bytes) {
  const std::size_t max_tables = 64 + bytes.size() / kMinAddedCellBytes;
  const Bytes copy = verified_copy(bytes, kChangesKind, max_tables);
  const schema::Changes& wire = *schema::GetChanges(copy.data());
  MapChanges changes;
  changes.since = wire.since();
  changes.revision = wire.revision();
  for (const schema::AddedCell* cell : *wire.added()) {
    changes.added.push_back(added_from_wire(*cell));
  }
  if (wire.moved()) changes.moved = moved_from_wire(*wire.moved());
  changes.removed = ids_from_wire<CellId>(wire.removed(), "removed");
  for (const schema::Constraint* constraint : *wire.added_constraints()) {
    changes.added_constraints.push_back(constraint_from_wire(*constraint));
  }
  changes.removed_constraints =
      ids_from_wire<ConstraintId>(wire.removed_constraints(), "removed_constraints");
  for (const CellId cell : ids_from_wire<CellId>(wire.unaligned(), "unaligned")) {
    changes.unaligned.insert(changes.unaligned.end(), cell);
  }
  if (wire.judged()) changes.judged = judged_from_wire(*wire.judged());
  check_changes(changes);
  return changes;
}

}  // namespace cellmap
