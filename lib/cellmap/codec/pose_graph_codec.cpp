#include "cellmap/codec/pose_graph_codec.hpp"

#include <cmath>
#include <cstring>
#include <string>

#include "cellmap/codec/constraint_wire.hpp"
#include "cellmap/codec/verified_buffer.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/schema/pose_graph_generated.h"

namespace cellmap {
namespace {

static_assert(sizeof(schema::Node) == 104 && sizeof(schema::Information) == 168 &&
                  sizeof(schema::Scores) == 48,
              "a struct of the format has changed: every file would become unreadable");

constexpr BufferKind kPoseGraphKind = {
    "pose graph", "CPGR", kMaxPoseGraphBytes,
    [](flatbuffers::Verifier& v) { return schema::VerifyPoseGraphBuffer(v); }};

std::string name_of(const Constraint& constraint) {
  return "constraint " + std::to_string(constraint.id.value) + " from CELL " +
         std::to_string(constraint.from.value) + " to CELL " + std::to_string(constraint.to.value);
}

Error corrupt_graph(const std::string& what) { return Error(ErrorCode::kCorruptData, what); }

bool is_share(double value) { return value >= 0.0 && value <= 1.0; }

void check_scores(const RegistrationScores& scores) {
  const bool ok = scores.hits <= scores.points && is_share(scores.inlier_ratio_all) &&
                  is_share(scores.inlier_ratio_hit) && is_share(scores.share_in_front) &&
                  is_share(scores.share_beyond) && std::isfinite(scores.median_residual_m) &&
                  scores.median_residual_m >= 0.0;
  if (!ok) {
    throw corrupt_graph(
        "its scores are out of range: hits <= points, shares in [0, 1], a finite residual");
  }
}

void check_kinds(const Constraint& constraint) {
  const int kind = static_cast<int>(constraint.kind), origin = static_cast<int>(constraint.origin);
  if (kind >= 1 && kind <= 3 && origin >= 1 && origin <= 3) return;
  throw Error(ErrorCode::kUnsupported, "its kind " + std::to_string(kind) + " or origin " +
                                           std::to_string(origin) + " is unknown to this build");
}

void check_ends(const Constraint& constraint, const PoseGraph& graph) {
  for (const CellId cell : {constraint.from, constraint.to}) {
    if (graph.nodes.contains(cell)) continue;
    throw corrupt_graph(name_of(constraint) + ": CELL " + std::to_string(cell.value) +
                        " is no node of the graph");
  }
}

/// The rules of FORMAT.md, "Pose graph", that hold for a graph as a whole.
void check_graph(const PoseGraph& graph) {
  for (const CellId cell : graph.unaligned) {
    if (!graph.nodes.contains(cell)) {
      throw corrupt_graph("the unaligned CELL " + std::to_string(cell.value) +
                          " is no node of the graph");
    }
  }
  ConstraintId last;
  for (const Constraint& constraint : graph.constraints) {
    check_constraint(constraint);
    check_ends(constraint, graph);
    if (constraint.id.value == 0) continue;  // not numbered yet
    if (constraint.id <= last) {
      throw corrupt_graph(name_of(constraint) + ": it follows constraint " +
                          std::to_string(last.value) + ", but ids increase");
    }
    last = constraint.id;
  }
}

schema::Information information_to_wire(const Matrix6d& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(0, 3), m(0, 4), m(0, 5), m(1, 1),
          m(1, 2), m(1, 3), m(1, 4), m(1, 5), m(2, 2), m(2, 3), m(2, 4),
          m(2, 5), m(3, 3), m(3, 4), m(3, 5), m(4, 4), m(4, 5), m(5, 5)};
}

Matrix6d information_from_wire(const schema::Information& wire) {
  double upper[21];
  static_assert(sizeof(upper) == sizeof(wire));
  std::memcpy(upper, &wire, sizeof(upper));
  Matrix6d m;
  for (int row = 0, k = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column, ++k) m(row, column) = m(column, row) = upper[k];
  }
  return m;
}

schema::Scores scores_to_wire(const RegistrationScores& s) {
  return {s.points,         s.hits,         s.inlier_ratio_all, s.inlier_ratio_hit,
          s.share_in_front, s.share_beyond, s.median_residual_m};
}

RegistrationScores scores_from_wire(const schema::Scores* wire) {
  if (!wire) return {};
  return {.points = wire->points(),
          .hits = wire->hits(),
          .inlier_ratio_all = wire->inlier_ratio_all(),
          .inlier_ratio_hit = wire->inlier_ratio_hit(),
          .share_in_front = wire->share_in_front(),
          .share_beyond = wire->share_beyond(),
          .median_residual_m = wire->median_residual_m()};
}

}  // namespace

flatbuffers::Offset<schema::Constraint> constraint_to_wire(flatbuffers::FlatBufferBuilder& builder,
                                                           const Constraint& c) {
  const schema::Pose T_from_to = pose_to_wire(c.T_from_to);
  const schema::Information information = information_to_wire(c.information);
  const schema::Scores scores = scores_to_wire(c.scores);
  return schema::CreateConstraint(builder, c.id.value, c.from.value, c.to.value,
                                  static_cast<schema::ConstraintKind>(c.kind),
                                  static_cast<schema::ConstraintOrigin>(c.origin), &T_from_to,
                                  &information, &scores, c.weight, c.pinned);
}

Constraint constraint_from_wire(const schema::Constraint& wire) {
  Constraint c;
  c.id.value = wire.id();
  c.from.value = wire.from();
  c.to.value = wire.to();
  c.kind = static_cast<ConstraintKind>(wire.kind());
  c.origin = static_cast<ConstraintOrigin>(wire.origin());
  c.T_from_to = pose_from_wire(wire.t_from_to(), "a constraint's pose T_from_to");
  c.information = information_from_wire(*wire.information());
  c.scores = scores_from_wire(wire.scores());
  c.weight = wire.weight();
  c.pinned = wire.pinned();
  return c;
}

void check_weight(double weight) {
  if (!is_share(weight)) throw corrupt_graph("its weight is not between 0 and 1");
}

void check_constraint(const Constraint& constraint) {
  try {
    check_kinds(constraint);
    validate(constraint);
    check_scores(constraint.scores);
    check_weight(constraint.weight);
  } catch (const Error& error) {
    const bool unsupported = error.code() == ErrorCode::kUnsupported;
    throw Error(unsupported ? ErrorCode::kUnsupported : ErrorCode::kCorruptData,
                name_of(constraint) + ": " + error.what());
  }
}

namespace {

std::map<CellId, Pose> nodes_from_wire(const flatbuffers::Vector<const schema::Node*>& wire) {
  std::map<CellId, Pose> nodes;
  for (flatbuffers::uoffset_t i = 0; i < wire.size(); ++i) {
    // The verifier does not check the alignment of structs in vectors, so they are never used in
    // place.
    schema::Node node;
    std::memcpy(static_cast<void*>(&node), wire.Data() + i * sizeof(node), sizeof(node));
    const CellId cell{node.cell()};
    if (!nodes.empty() && cell <= nodes.rbegin()->first) {
      throw corrupt_graph("the pose graph's node of CELL " + std::to_string(cell.value) +
                          " follows that of CELL " + std::to_string(nodes.rbegin()->first.value) +
                          ", but ids increase");
    }
    const Pose T_map_cell = pose_from_wire(&node.t_map_cell(), "a node's pose T_map_cell");
    nodes.emplace_hint(nodes.end(), cell, T_map_cell);
  }
  return nodes;
}

}  // namespace

Bytes encode_pose_graph(const PoseGraph& graph) {
  std::vector<schema::Node> nodes;
  nodes.reserve(graph.nodes.size());
  for (const auto& [cell, T_map_cell] : graph.nodes) {
    if (!is_rigid(T_map_cell)) {
      throw corrupt_graph("the pose of CELL " + std::to_string(cell.value) +
                          " is not a rigid transform of finite numbers");
    }
    nodes.emplace_back(cell.value, pose_to_wire(T_map_cell));
  }
  check_graph(graph);
  flatbuffers::FlatBufferBuilder builder(1024 + 128 * nodes.size() +
                                         384 * graph.constraints.size());
  const auto wire_nodes = builder.CreateVectorOfStructs(nodes);
  std::vector<flatbuffers::Offset<schema::Constraint>> constraints;
  constraints.reserve(graph.constraints.size());
  for (const Constraint& constraint : graph.constraints) {
    constraints.push_back(constraint_to_wire(builder, constraint));
  }
  const auto wire_constraints = builder.CreateVector(constraints);
  flatbuffers::Offset<flatbuffers::Vector<std::uint32_t>> wire_unaligned;
  if (!graph.unaligned.empty()) {
    std::vector<std::uint32_t> unaligned;
    for (const CellId cell : graph.unaligned) unaligned.push_back(cell.value);
    wire_unaligned = builder.CreateVector(unaligned);
  }
  schema::FinishPoseGraphBuffer(
      builder, schema::CreatePoseGraph(builder, kFormatVersion, graph.revision, wire_nodes,
                                       wire_constraints, wire_unaligned));
  const auto* begin = reinterpret_cast<const std::byte*>(builder.GetBufferPointer());
  return Bytes(begin, begin + builder.GetSize());
}

PoseGraph decode_pose_graph(std::span<const std::byte> bytes) {
  const std::size_t max_tables = 64 + bytes.size() / kMinConstraintBytes;
  const Bytes copy = verified_copy(bytes, kPoseGraphKind, max_tables);
  const schema::PoseGraph& wire = *schema::GetPoseGraph(copy.data());
  PoseGraph graph;
  graph.revision = wire.revision();
  graph.nodes = nodes_from_wire(*wire.nodes());
  graph.constraints.reserve(wire.constraints()->size());
  for (const schema::Constraint* constraint : *wire.constraints()) {
    graph.constraints.push_back(constraint_from_wire(*constraint));
  }
  if (wire.unaligned()) {
    for (const std::uint32_t cell : *wire.unaligned()) {
      if (!graph.unaligned.empty() && cell <= graph.unaligned.rbegin()->value) {
        throw corrupt_graph("the ids of unaligned CELLs do not increase");
      }
      graph.unaligned.insert(graph.unaligned.end(), CellId{cell});
    }
  }
  check_graph(graph);
  return graph;
}

}  // namespace cellmap
