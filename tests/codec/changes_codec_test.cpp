#include "cellmap/codec/changes_codec.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "cellmap/codec/byte_planes.hpp"
#include "cellmap/codec/pose_grid.hpp"
#include "cellmap/codec/zstd.hpp"
#include "codec/raw_buffer.hpp"
#include "codec/samples.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::expect_error;

// --- The grid of poses ----------------------------------------------------------------------

/// The same by way of the quaternion, as the books write it.
Eigen::Matrix3d rotation_twin(const GridPose& grid) {
  const Eigen::Vector3d p =
      Eigen::Vector3d(grid.rotation[0], grid.rotation[1], grid.rotation[2]) * kGridRotationStep;
  const double s = p.squaredNorm();
  const Eigen::Vector3d v = 2 * p / (1 + s);
  return Eigen::Quaterniond((1 - s) / (1 + s), v.x(), v.y(), v.z()).toRotationMatrix();
}

TEST(PoseGrid, APoseComesBackWithinTheStatedError) {
  std::mt19937 rng(1);
  double worst_m = 0, worst_rad = 0;
  for (int i = 0; i < 20'000; ++i) {
    const Pose T = random_pose(rng);
    const Pose back = from_grid(to_grid(T));
    worst_m = std::max(worst_m, (back.translation() - T.translation()).norm());
    worst_rad = std::max(worst_rad, angle_between_rad(T, back));
    EXPECT_TRUE(is_rigid(back));
    EXPECT_TRUE(back.linear().isApprox(rotation_twin(to_grid(T)), 1e-14));
  }
  EXPECT_LE(worst_m, kGridTranslationError_m);
  EXPECT_LE(worst_rad, kGridRotationError_rad);
  EXPECT_GT(worst_m, 0.5 * kGridTranslationError_m);  // the bounds are no larger than they must be
  EXPECT_GT(worst_rad, 0.5 * kGridRotationError_rad);
}

TEST(PoseGrid, APoseOfTheGridStaysWhatItIs) {
  std::mt19937 rng(2);
  for (int i = 0; i < 20'000; ++i) {
    const GridPose grid = to_grid(random_pose(rng));
    const Pose T = from_grid(grid);
    EXPECT_EQ(to_grid(T), grid);
    EXPECT_EQ(from_grid(to_grid(T)).matrix(), T.matrix());
  }
}

TEST(PoseGrid, HalfATurnAboutAnyAxisKeepsTheStatedError) {
  std::mt19937 rng(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int i = 0; i < 2'000; ++i) {
    const Eigen::Vector3d axis =
        Eigen::Vector3d(uniform(rng), uniform(rng), uniform(rng)).normalized();
    const double angle = std::numbers::pi + (i % 3 - 1) * 1e-7;
    Pose T = Pose::Identity();
    T.linear() = Eigen::AngleAxisd(angle, axis).toRotationMatrix();
    const Pose back = from_grid(to_grid(T));
    EXPECT_LE(angle_between_rad(T, back), kGridRotationError_rad);
    for (const auto value : to_grid(T).rotation) EXPECT_LE(std::abs(value), kMaxGridRotation);
  }
}

TEST(PoseGrid, RefusesWhatIsNoPoseOrTooFarAway) {
  Pose T = Pose::Identity();
  T.translation().x() = 16'777'216;
  EXPECT_EQ(from_grid(to_grid(T)).translation().x(), 16'777'216);
  T.translation().x() = -16'777'217;
  expect_error(
      ErrorCode::kCorruptData, [&] { to_grid(T); }, "16,777 km");
  T.translation().x() = std::nan("");
  expect_error(
      ErrorCode::kCorruptData, [&] { to_grid(T); }, "finite");
  T = Pose::Identity();
  T.linear() *= 1.01;
  expect_error(
      ErrorCode::kCorruptData, [&] { to_grid(T); }, "rigid");
}

// --- Columns --------------------------------------------------------------------------------

TEST(Column, ComesBackWhateverIsInIt) {
  constexpr std::int64_t kMin = INT64_MIN, kMax = INT64_MAX;
  const std::vector<std::vector<std::int64_t>> columns = {
      {0}, {-1}, {5, 5, 5}, {1, 2, 3, 4}, {kMin, kMax, kMin, 0}, {kMax, kMax, kMin, kMin, 7}};
  for (const auto& column : columns) {
    EXPECT_EQ(decode_column(encode_column(column), column.size(), "c"), column);
  }
}

TEST(Column, AStraightLineCostsOnlyItsStart) {
  std::vector<std::int64_t> line;
  for (std::int64_t i = 0; i < 1000; ++i) line.push_back(100'000 + 3 * i);
  EXPECT_EQ(encode_column(line).size(), 3 * line.size());  // 100,000 with its sign: 18 bits
  EXPECT_LT(zstd_compress(encode_column(line)).size(), 60u);
}

TEST(Column, HasTheBytesOfTheFormat) {
  // 1000 as it is, 1001 - 1000 = 1, 999 - (2 * 1001 - 1000) = -3; folded 2000, 2, 5.
  const Bytes expected = {std::byte{0xd0}, std::byte{2}, std::byte{5},
                          std::byte{0x07}, std::byte{0}, std::byte{0}};
  EXPECT_EQ(encode_column(std::vector<std::int64_t>{1000, 1001, 999}), expected);
}

TEST(Column, ALengthThatDoesNotFitIsRefused) {
  for (const std::size_t size : {1u, 2u, 4u, 27u}) {
    expect_error(
        ErrorCode::kCorruptData, [&] { decode_column(Bytes(size), 3, "rx"); }, "'rx' of 3 rows");
  }
}

// --- Changes --------------------------------------------------------------------------------

/// Two CELLs added, `moved` others moved, a CELL and constraints gone, three constraints new.
MapChanges random_changes(std::uint32_t seed, std::uint32_t moved) {
  std::mt19937 rng(seed);
  MapChanges changes;
  changes.since = 1ull << 40;
  changes.revision = changes.since + 12;
  for (std::uint32_t i = 0; i < 2; ++i) {
    CellRecord cell;
    cell.id = CellId{4'000'000'000u + i};
    for (auto& byte : cell.hash.bytes) byte = static_cast<std::uint8_t>(rng());
    cell.added = changes.since + 1 + i;
    cell.moved = changes.revision;
    cell.T_map_cell = random_pose(rng);
    cell.session = "monday";
    cell.sequence = 900 + i;
    cell.planes = 5'000;
    cell.encoded_bytes = 1ull << 33;
    changes.added.push_back(cell);
  }
  for (std::uint32_t i = 0; i < moved; ++i) changes.moved[CellId{3 * i + 1}] = random_pose(rng);
  changes.removed = {CellId{2}, CellId{5}};
  changes.unaligned = {CellId{70}, CellId{71}, CellId{90}};
  for (std::uint32_t i = 0; i < 3; ++i) {
    Constraint constraint;
    constraint.id = ConstraintId{10 + 2 * i};
    constraint.from = CellId{1};
    constraint.to = CellId{4 + i};
    constraint.T_from_to = random_pose(rng);
    const Matrix6d root = Matrix6d::Random();
    constraint.information = root * root.transpose();
    constraint.kind = static_cast<ConstraintKind>(1 + i);
    constraint.origin = static_cast<ConstraintOrigin>(1 + i);
    constraint.scores = {1000, 900, 0.4, 0.9, 0.01, 0.02, 0.03};
    changes.added_constraints.push_back(constraint);
  }
  changes.removed_constraints = {ConstraintId{3}, ConstraintId{9}};
  changes.judged = {{ConstraintId{4}, {0.0, false}}, {ConstraintId{11}, {0.375, true}}};
  changes.added_constraints[1].weight = 0.125;
  changes.added_constraints[2].pinned = true;
  return changes;
}

TEST(ChangesCodec, EverythingComesBackAndMovedPosesFromTheGrid) {
  const MapChanges changes = random_changes(1, 40);
  const MapChanges back = decode_changes(encode_changes(changes));
  EXPECT_EQ(back.since, changes.since);
  EXPECT_EQ(back.revision, changes.revision);
  ASSERT_EQ(back.added.size(), 2u);
  EXPECT_EQ(back.added[1].id, changes.added[1].id);
  EXPECT_EQ(back.added[1].hash, changes.added[1].hash);
  EXPECT_EQ(back.added[1].added, changes.added[1].added);
  EXPECT_EQ(back.added[1].moved, changes.added[1].moved);
  EXPECT_EQ(back.added[1].T_map_cell.matrix(), changes.added[1].T_map_cell.matrix());
  EXPECT_EQ(back.added[1].session, "monday");
  EXPECT_EQ(back.added[1].sequence, 901u);
  EXPECT_EQ(back.added[1].planes, 5'000u);
  EXPECT_EQ(back.added[1].encoded_bytes, 1ull << 33);
  ASSERT_EQ(back.moved.size(), changes.moved.size());
  for (const auto& [id, pose] : changes.moved) {
    EXPECT_EQ(back.moved.at(id).matrix(), from_grid(to_grid(pose)).matrix());
  }
  EXPECT_EQ(back.removed, changes.removed);
  EXPECT_EQ(back.unaligned, changes.unaligned);
  ASSERT_EQ(back.added_constraints.size(), 3u);
  for (int i = 0; i < 3; ++i) {
    const Constraint &is = back.added_constraints[i], &was = changes.added_constraints[i];
    EXPECT_EQ(is.id, was.id);
    EXPECT_EQ(is.to, was.to);
    EXPECT_EQ(is.kind, was.kind);
    EXPECT_EQ(is.origin, was.origin);
    EXPECT_EQ(is.T_from_to.matrix(), was.T_from_to.matrix());
    EXPECT_EQ(is.information.triangularView<Eigen::Upper>().toDenseMatrix(),
              was.information.triangularView<Eigen::Upper>().toDenseMatrix());
    EXPECT_EQ(is.scores.median_residual_m, was.scores.median_residual_m);
    EXPECT_EQ(judgement(is), judgement(was));
  }
  EXPECT_EQ(back.judged, changes.judged);
  EXPECT_EQ(back.removed_constraints, changes.removed_constraints);
}

TEST(ChangesCodec, NothingAndASingleCellComeBackToo) {
  MapChanges changes;
  changes.since = changes.revision = 7;
  EXPECT_EQ(decode_changes(encode_changes(changes)).revision, 7u);
  for (const std::uint32_t id : {0u, 1u, UINT32_MAX}) {
    changes.moved = {{CellId{id}, Pose::Identity()}};
    const auto moved = decode_changes(encode_changes(changes)).moved;
    ASSERT_EQ(moved.size(), 1u) << id;
    EXPECT_EQ(moved.begin()->first.value, id);
    EXPECT_EQ(moved.begin()->second.matrix(), Pose::Identity().matrix());
  }
}

TEST(ChangesCodec, DecodedChangesEncodeToTheSameBytes) {
  const Bytes bytes = encode_changes(random_changes(2, 100));
  EXPECT_EQ(encode_changes(decode_changes(bytes)), bytes);
}

TEST(ChangesCodec, ErrorsDoNotAddUpOverManyUpdates) {
  std::mt19937 rng(3);
  std::normal_distribution<double> noise(0, 0.01);
  Pose truth = random_pose(rng), mirrored = truth;
  for (int update = 0; update < 1'000; ++update) {
    Tangent step;
    for (int i = 0; i < 6; ++i) step[i] = noise(rng);
    truth = exp(step) * truth;
    MapChanges changes;
    changes.moved[CellId{1}] = truth;
    mirrored = decode_changes(encode_changes(changes)).moved.at(CellId{1});
  }
  EXPECT_LE((mirrored.translation() - truth.translation()).norm(), kGridTranslationError_m);
  EXPECT_LE(angle_between_rad(mirrored, truth), kGridRotationError_rad);
}

TEST(ChangesCodec, BrokenRulesAreRefusedByWriterAndReader) {
  const auto refuses = [](const std::string& part, auto&& spoil) {
    MapChanges changes = random_changes(4, 5);
    spoil(changes);
    expect_error(
        ErrorCode::kCorruptData, [&] { encode_changes(changes); }, part);
  };
  refuses("before revision", [](auto& c) { c.revision = c.since - 1; });
  refuses("ids increase", [](auto& c) { std::swap(c.added[0].id, c.added[1].id); });
  refuses("not added after", [](auto& c) { c.added[0].added = c.since; });
  refuses("not added after", [](auto& c) { c.added[0].moved = c.revision + 1; });
  refuses("no session", [](auto& c) { c.added[0].session = "a/b"; });
  refuses("rigid", [](auto& c) { c.added[0].T_map_cell.linear()(0, 0) += 1; });
  refuses("too", [](auto& c) { c.moved[c.added[0].id] = Pose::Identity(); });
  refuses("rigid", [](auto& c) { c.moved.begin()->second.translation().x() = NAN; });
  refuses("removed CELL", [](auto& c) { c.removed = {CellId{2}, CellId{2}}; });
  refuses("removed constraint", [](auto& c) {
    std::reverse(c.removed_constraints.begin(), c.removed_constraints.end());
  });
  refuses("no number", [](auto& c) { c.added_constraints[0].id = {}; });
  refuses("added constraint",
          [](auto& c) { c.added_constraints[1].id = c.added_constraints[0].id; });
  refuses("weight", [](auto& c) { c.added_constraints[0].weight = 1.5; });
  refuses("weight", [](auto& c) { c.judged.begin()->second.weight = NAN; });
  refuses("judged ones too", [](auto& c) { c.judged[c.added_constraints[0].id] = {}; });
  refuses("no number", [](auto& c) { c.judged[ConstraintId{0}] = {}; });
  refuses("itself", [](auto& c) { c.added_constraints[0].to = c.added_constraints[0].from; });
}

TEST(ChangesCodec, AColumnThatLiesIsRefused) {
  MapChanges changes;
  for (std::uint32_t id = 1; id <= 20; ++id) changes.moved[CellId{id}] = Pose::Identity();
  const Bytes good = encode_changes(changes);
  const auto spoiled = [&](auto&& spoil) {
    Bytes bytes = good;
    RawBuffer raw(bytes);
    spoil(raw, raw.target(raw.target(raw.root(), 4), 0));
    return thrown_by([&] { decode_changes(bytes); });
  };
  ASSERT_FALSE(spoiled([](RawBuffer&, std::size_t) {}));
  for (const std::uint32_t count : {0u, 1u, 19u, 21u, 2'000'000u, 2'097'153u, UINT32_MAX}) {
    const auto thrown = spoiled([&](RawBuffer& raw, std::size_t cells) {
      raw.set<std::uint32_t>(raw.field(cells, 0), count);
    });
    ASSERT_TRUE(thrown) << count;
    EXPECT_EQ(thrown->code,
              count > kMaxIdsInChanges ? ErrorCode::kTooLarge : ErrorCode::kCorruptData)
        << thrown->message;
  }
  const auto backwards = spoiled([](RawBuffer& raw, std::size_t cells) {
    raw.set<std::uint8_t>(raw.target(cells, 1) + 4 + 7, 9);  // the line of ids bends down
  });
  ASSERT_TRUE(backwards);
  EXPECT_NE(backwards->message.find("do not increase"), std::string::npos) << backwards->message;
}

TEST(ChangesCodec, CutChangesAreRefusedAtEveryLength) {
  const Bytes bytes = encode_changes(random_changes(5, 3));
  constexpr std::size_t kPadding = 7;  // the last bytes may be that
  for (std::size_t size = 0; size < bytes.size() - kPadding; ++size) {
    const auto thrown = thrown_by([&] { decode_changes(std::span(bytes).first(size)); });
    ASSERT_TRUE(thrown) << size;
    EXPECT_EQ(thrown->code, ErrorCode::kCorruptData);
  }
}

TEST(ChangesCodec, ANewerVersionIsSaidToBeOne) {
  Bytes bytes = encode_changes(random_changes(6, 3));
  RawBuffer raw(bytes);
  raw.set<std::uint16_t>(raw.field(raw.root(), 0), 2);
  expect_error(
      ErrorCode::kUnsupported, [&] { decode_changes(bytes); }, "version 2");
}

}  // namespace
}  // namespace cellmap
