#include "cellmap/codec/pose_graph_codec.hpp"

#include <gtest/gtest.h>

#include <functional>
#include <limits>

#include "codec/raw_buffer.hpp"
#include "codec/samples.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::expect_error;

constexpr int kGraphVersion = 0, kNodes = 2, kConstraints = 3;
constexpr int kId = 0, kFrom = 1, kTo = 2, kKind = 3, kOrigin = 4, kConstraintPose = 5,
              kInformation = 6, kScores = 7;
constexpr std::size_t kNodeBytes = 104;
constexpr double kNoNumber = std::numeric_limits<double>::quiet_NaN();

Constraint random_constraint(std::mt19937& rng, std::uint32_t id, std::uint32_t from,
                             std::uint32_t to) {
  Constraint c;
  c.id.value = id;
  c.from.value = from;
  c.to.value = to;
  c.T_from_to = random_pose(rng);
  const Matrix6d A = Matrix6d::NullaryExpr([&](auto, auto) { return double(rng() % 1000) / 7.0; });
  c.information = A * A.transpose() + Matrix6d::Identity();
  c.information = (0.5 * (c.information + c.information.transpose())).eval();
  c.kind = ConstraintKind(1 + (id / 5 + 1) % 3);
  c.origin = ConstraintOrigin(1 + id / 5 % 3);
  if (c.kind != ConstraintKind::kOdometry) c.scores = {1000, 900, 0.8, 0.9, 0.01, 0.1, 0.045};
  return c;
}

PoseGraph random_graph(std::uint32_t seed, std::uint32_t nodes) {
  std::mt19937 rng(seed);
  PoseGraph graph;
  graph.revision = 1'000'000'000'000 + seed;
  for (std::uint32_t i = 0; i < nodes; ++i) graph.nodes[CellId{10 + 2 * i}] = random_pose(rng);
  for (std::uint32_t i = 1; i < nodes; ++i) {
    graph.constraints.push_back(random_constraint(rng, 5 * i, 8 + 2 * i, 10 + 2 * i));
  }
  return graph;
}

void expect_equal(const PoseGraph& a, const PoseGraph& b) {
  EXPECT_EQ(a.revision, b.revision);
  ASSERT_EQ(a.nodes.size(), b.nodes.size());
  for (const auto& [cell, T_map_cell] : a.nodes) {
    EXPECT_EQ(T_map_cell.matrix(), b.nodes.at(cell).matrix());
  }
  ASSERT_EQ(a.constraints.size(), b.constraints.size());
  for (std::size_t i = 0; i < a.constraints.size(); ++i) {
    const Constraint &c = a.constraints[i], &d = b.constraints[i];
    EXPECT_EQ(c.id, d.id);
    EXPECT_EQ(c.from, d.from);
    EXPECT_EQ(c.to, d.to);
    EXPECT_EQ(c.kind, d.kind);
    EXPECT_EQ(c.origin, d.origin);
    EXPECT_EQ(c.T_from_to.matrix(), d.T_from_to.matrix());
    EXPECT_EQ(c.information, d.information);
    EXPECT_EQ(c.scores.points, d.scores.points);
    EXPECT_EQ(c.scores.hits, d.scores.hits);
    EXPECT_EQ(c.scores.inlier_ratio_all, d.scores.inlier_ratio_all);
    EXPECT_EQ(c.scores.inlier_ratio_hit, d.scores.inlier_ratio_hit);
    EXPECT_EQ(c.scores.share_in_front, d.scores.share_in_front);
    EXPECT_EQ(c.scores.share_beyond, d.scores.share_beyond);
    EXPECT_EQ(c.scores.median_residual_m, d.scores.median_residual_m);
  }
}

/// Where constraint `i` of a buffer is.
std::size_t constraint_at(const RawBuffer& raw, std::size_t i) {
  const std::size_t at = raw.target(raw.root(), kConstraints) + 4 + 4 * i;
  return at + raw.get<std::uint32_t>(at);
}
std::size_t node_at(const RawBuffer& raw, std::size_t i) {
  return raw.target(raw.root(), kNodes) + 4 + kNodeBytes * i;
}

Bytes broken(const std::function<void(RawBuffer&)>& damage) {
  Bytes bytes = encode_pose_graph(random_graph(1, 6));
  RawBuffer raw(bytes);
  damage(raw);
  return bytes;
}

TEST(PoseGraphCodec, AGraphSurvivesTheRoundTripExactly) {
  for (const std::uint32_t nodes : {0, 1, 2, 3, 10, 577}) {
    const PoseGraph graph = random_graph(nodes, nodes);
    const Bytes bytes = encode_pose_graph(graph);
    expect_equal(decode_pose_graph(bytes), graph);
    EXPECT_EQ(encode_pose_graph(decode_pose_graph(bytes)), bytes);
  }
}

TEST(PoseGraphCodec, ConstraintsThatAreNotNumberedYetMayStandAnywhere) {
  PoseGraph graph = random_graph(2, 6);
  graph.constraints[0].id = graph.constraints[3].id = graph.constraints[4].id = ConstraintId{};
  expect_equal(decode_pose_graph(encode_pose_graph(graph)), graph);
}

TEST(PoseGraphCodec, EveryBrokenRuleIsNamed) {
  struct Case {
    const char* message;
    std::function<void(RawBuffer&)> damage;
  };
  const std::vector<Case> cases = {
      {"CELL 99 is no node",
       [](RawBuffer& r) { r.set<std::uint32_t>(r.field(constraint_at(r, 2), kTo), 99); }},
      {"CELL 11 is no node",
       [](RawBuffer& r) { r.set<std::uint32_t>(r.field(constraint_at(r, 2), kFrom), 11); }},
      {"constraint 15",
       [](RawBuffer& r) {
         const std::size_t at = constraint_at(r, 2);
         r.set(r.field(at, kTo), r.get<std::uint32_t>(r.field(at, kFrom)));
       }},
      {"ids increase",
       [](RawBuffer& r) { r.set<std::uint32_t>(r.field(constraint_at(r, 2), kId), 10); }},
      {"T_from_to",
       [](RawBuffer& r) { r.set(r.field(constraint_at(r, 2), kConstraintPose), kNoNumber); }},
      {"T_map_cell", [](RawBuffer& r) { r.set(node_at(r, 3) + 8, 3.0); }},
      {"ids increase", [](RawBuffer& r) { r.set<std::uint32_t>(node_at(r, 3), 14); }},
      {"constraint 15",
       [](RawBuffer& r) { r.set(r.field(constraint_at(r, 2), kInformation), kNoNumber); }},
      {"constraint 15",
       [](RawBuffer& r) { r.set(r.field(constraint_at(r, 2), kInformation), -1e9); }},
      {"scores",
       [](RawBuffer& r) { r.set<std::uint32_t>(r.field(constraint_at(r, 2), kScores), 1); }},
      {"scores", [](RawBuffer& r) { r.set(r.field(constraint_at(r, 2), kScores) + 8, 1.5); }},
      {"scores",
       [](RawBuffer& r) { r.set(r.field(constraint_at(r, 2), kScores) + 40, kNoNumber); }},
      {"field is missing",
       [](RawBuffer& r) { r.drop_field(constraint_at(r, 2), kConstraintPose); }},
      {"field is missing", [](RawBuffer& r) { r.drop_field(constraint_at(r, 2), kInformation); }},
      {"field is missing", [](RawBuffer& r) { r.drop_field(r.root(), kNodes); }},
      {"field is missing", [](RawBuffer& r) { r.drop_field(r.root(), kConstraints); }},
      {"version", [](RawBuffer& r) { r.drop_field(r.root(), kGraphVersion); }},
  };
  // Constraint 2 of the graph must carry scores for the cases above to break them.
  ASSERT_NE(random_graph(1, 6).constraints[2].scores.points, 0u);
  for (std::size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE("case " + std::to_string(i));
    const Bytes bytes = broken(cases[i].damage);
    expect_error(
        ErrorCode::kCorruptData, [&] { decode_pose_graph(bytes); }, cases[i].message);
  }
}

TEST(PoseGraphCodec, WhatALaterVersionMayBringIsCalledUnsupported) {
  const Bytes version =
      broken([](RawBuffer& r) { r.set<std::uint16_t>(r.field(r.root(), kGraphVersion), 7); });
  const Bytes kind =
      broken([](RawBuffer& r) { r.set<std::uint8_t>(r.field(constraint_at(r, 2), kKind), 4); });
  const Bytes origin =
      broken([](RawBuffer& r) { r.set<std::uint8_t>(r.field(constraint_at(r, 2), kOrigin), 200); });
  expect_error(
      ErrorCode::kUnsupported, [&] { decode_pose_graph(version); }, "version 7");
  expect_error(
      ErrorCode::kUnsupported, [&] { decode_pose_graph(kind); }, "kind 4");
  expect_error(
      ErrorCode::kUnsupported, [&] { decode_pose_graph(origin); }, "origin 200");
}

TEST(PoseGraphCodec, AbsentScoresAreZero) {
  const Bytes bytes = broken([](RawBuffer& r) { r.drop_field(constraint_at(r, 2), kScores); });
  EXPECT_EQ(decode_pose_graph(bytes).constraints[2].scores.points, 0u);
}

TEST(PoseGraphCodec, AConstraintThatIsRepeatedToMakeTheReaderAllocateIsRefused) {
  // One unnumbered constraint and a vector of offsets that all point to it: four bytes each in the
  // file, half a kilobyte each in memory.
  PoseGraph graph = random_graph(3, 5);
  for (Constraint& c : graph.constraints) c.id = ConstraintId{};
  Bytes bytes = encode_pose_graph(graph);
  const std::uint32_t copies = 100'000;
  RawBuffer raw(bytes);
  const std::size_t first = constraint_at(raw, 0);
  // FlatBuffers offsets are unsigned, so the table must come last: vector, then table and vtable.
  const std::size_t vector_at = (bytes.size() + 7) / 8 * 8, span = 4 + 4 * std::size_t{copies};
  const std::size_t table_at = (vector_at + span + 64 + 7) / 8 * 8 + first % 8;
  bytes.resize(table_at + 400);
  const auto vtable_distance = raw.get<std::int32_t>(first);
  std::memcpy(bytes.data() + table_at, bytes.data() + first, 400);
  raw.set<std::int32_t>(table_at, static_cast<std::int32_t>(table_at - first) + vtable_distance);
  raw.set<std::uint32_t>(vector_at, copies);
  for (std::size_t i = 0; i < copies; ++i) {
    const std::size_t at = vector_at + 4 + 4 * i;
    raw.set<std::uint32_t>(at, static_cast<std::uint32_t>(table_at - at));
  }
  const std::size_t field = raw.field(raw.root(), kConstraints);
  raw.set<std::uint32_t>(field, static_cast<std::uint32_t>(vector_at - field));
  raw.set<std::uint32_t>(vector_at, 4);
  EXPECT_EQ(decode_pose_graph(bytes).constraints.size(), 4u) << "the forged file is well-formed";
  raw.set<std::uint32_t>(vector_at, copies);
  expect_error(ErrorCode::kCorruptData, [&] { decode_pose_graph(bytes); });
}

TEST(PoseGraphCodec, AGraphThatWouldBeRefusedIsNotEncoded) {
  PoseGraph graph = random_graph(4, 3);
  graph.constraints[0].to = CellId{1000};
  expect_error(
      ErrorCode::kCorruptData, [&] { encode_pose_graph(graph); }, "CELL 1000");
  graph = random_graph(4, 3);
  graph.nodes.begin()->second.translation().x() = kNoNumber;
  expect_error(
      ErrorCode::kCorruptData, [&] { encode_pose_graph(graph); }, "CELL 10");
}

TEST(PoseGraphCodec, TruncationAndFlippedBitsNeverCrash) {
  const Bytes good = encode_pose_graph(random_graph(5, 3));
  for (std::size_t at = 0; at < good.size(); ++at) {
    const Bytes truncated(good.begin(), good.begin() + at);
    expect_error(ErrorCode::kCorruptData, [&] { decode_pose_graph(truncated); });
    for (int bit = 0; bit < 8; ++bit) {
      Bytes flipped = good;
      flipped[at] ^= std::byte{1} << bit;
      std::optional<PoseGraph> graph;
      thrown_by([&] { graph = decode_pose_graph(flipped); });
      if (graph) {
        EXPECT_NO_THROW(encode_pose_graph(*graph)) << "what was accepted is a valid graph";
      }
    }
  }
}

TEST(PoseGraphCodec, NodesAtAnyAlignmentAreRead) {
  // The verifier lets structs in vectors lie at any multiple of four.
  const PoseGraph graph = random_graph(6, 4);
  Bytes bytes = encode_pose_graph(graph);
  RawBuffer raw(bytes);
  const std::size_t field = raw.field(raw.root(), kNodes), old = raw.target(raw.root(), kNodes);
  for (const std::size_t shift : {0, 4}) {
    const std::size_t at = (bytes.size() + 15) / 16 * 16 + shift, length = 4 + 4 * kNodeBytes;
    bytes.resize(at + length);
    std::memmove(bytes.data() + at, bytes.data() + old, length);
    raw.set<std::uint32_t>(field, static_cast<std::uint32_t>(at - field));
    expect_equal(decode_pose_graph(bytes), graph);
  }
}

}  // namespace
}  // namespace cellmap
