#include "cellmap/client/json.hpp"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "codec/samples.hpp"
#include "support/expect_error.hpp"

namespace cellmap::client {
namespace {

TEST(Json, TimesAreReadWithAndWithoutFractions) {
  // 2026-11-22T03:45:09Z: date -u -d 2026-11-22T03:45:09Z +%s
  constexpr Stamp kTime = 1'795'319'109'000'000'000;
  EXPECT_EQ(stamp_from_rfc3339("2026-11-22T03:45:09Z"), kTime);
  EXPECT_EQ(stamp_from_rfc3339("2026-11-22T03:45:09.250Z"), kTime + 250'000'000);
  EXPECT_EQ(to_rfc3339(kTime + 250'000'000), "2026-11-22T03:45:09.250Z");
  EXPECT_EQ(stamp_from_rfc3339("1970-01-01T00:00:00Z"), 0);
  for (const char* wrong : {"", "yesterday", "2026-02-30T00:00:00Z", "2026-11-22T24:00:00Z",
                            "2026-11-22T03:45:09", "2026-11-22T03:45:09Zx"}) {
    test::expect_error(ErrorCode::kCorruptData, [&] { stamp_from_rfc3339(wrong); });
  }
}

TEST(Json, ASymmetricMatrixIsItsUpperTriangleByRows) {
  Matrix6d matrix;
  for (int r = 0; r < 6; ++r) {
    for (int c = 0; c < 6; ++c) matrix(r, c) = 10 * std::min(r, c) + std::max(r, c);
  }
  const Json json = to_json(matrix);
  ASSERT_EQ(json.size(), 21u);
  EXPECT_EQ(json[1], 1.0);
  EXPECT_EQ(json[6], 11.0);
  EXPECT_EQ(json[20], 55.0);
  EXPECT_EQ(matrix_from_json(json), matrix);
  test::expect_error(ErrorCode::kCorruptData, [&] { matrix_from_json(Json::array({1, 2})); });
}

TEST(Json, AMapsSummaryReadsBack) {
  MapInfo map;
  map.name = "town";
  map.lattice.size = 20'000;
  map.revision = 4;
  map.created = 1'795'319'109'125'000'000;
  map.cells = 3;
  map.raw_points = 100;
  map.voxel_points = 10;
  map.bounds.extend(Eigen::Vector3d(-1, -2, -3));
  map.bounds.extend(Eigen::Vector3d(4, 5, 6));
  map.sessions = {"a", "b"};
  const Json json = to_json(map);
  EXPECT_EQ(json.at("raw_bytes"), 1600);
  EXPECT_EQ(json.at("voxel_bytes"), 120);
  const MapInfo back = map_info_from_json(json);
  EXPECT_EQ(back.name, map.name);
  EXPECT_EQ(back.lattice, map.lattice);
  EXPECT_EQ(back.created, map.created);
  EXPECT_EQ(back.sessions, map.sessions);
  EXPECT_EQ(back.bounds.max(), map.bounds.max());
  map.bounds.setEmpty();
  EXPECT_TRUE(map_info_from_json(to_json(map)).bounds.isEmpty());
}

TEST(Json, NumbersThatDoNotFitTheirTypeAreRefusedNotCut) {
  CellRecord cell;
  cell.session = "s";
  Json json = to_json(cell);
  EXPECT_NO_THROW(cell_record_from_json(json));
  for (const Json& wrong : {Json(-1), Json(4'294'967'296), Json(1.5), Json("7"), Json(nullptr)}) {
    json["id"] = wrong;
    test::expect_error(ErrorCode::kCorruptData, [&] { cell_record_from_json(json); });
  }
}

TEST(Json, AConstraintReadsBack) {
  std::mt19937 rng(1);
  Constraint constraint;
  constraint.id = ConstraintId{9};
  constraint.from = CellId{1};
  constraint.to = CellId{5};
  constraint.T_from_to = random_pose(rng);
  constraint.information = Matrix6d::Identity() * 3;
  constraint.kind = ConstraintKind::kLoop;
  constraint.origin = ConstraintOrigin::kUser;
  constraint.scores.inlier_ratio_hit = 0.9;
  const Constraint back = constraint_from_json(to_json(constraint));
  EXPECT_TRUE(back.T_from_to.isApprox(constraint.T_from_to, 1e-12));
  EXPECT_EQ(back.kind, constraint.kind);
  EXPECT_EQ(back.origin, constraint.origin);
  EXPECT_EQ(back.information, constraint.information);
  EXPECT_EQ(back.scores.inlier_ratio_hit, 0.9);
}

TEST(Json, APoseThatIsNoneIsRefused) {
  for (const char* wrong : {"[0,0,0,0,0,0,0]", "[0,0,0,0,0,0]", "[0,0,0,0,0,0,\"1\"]", "{}"}) {
    test::expect_error(ErrorCode::kCorruptData, [&] { pose_from_json(parse_json(wrong)); });
  }
}

TEST(Problems, WithoutADocumentTheStatusDecides) {
  const auto code = [](int status) {
    return problem_to_error(status, "text/html", "", "GET x").code();
  };
  EXPECT_EQ(code(400), ErrorCode::kInvalidArgument);
  EXPECT_EQ(code(404), ErrorCode::kNotFound);
  EXPECT_EQ(code(409), ErrorCode::kConflict);
  EXPECT_EQ(code(413), ErrorCode::kTooLarge);
  EXPECT_EQ(code(415), ErrorCode::kUnsupported);
  EXPECT_EQ(code(422), ErrorCode::kCorruptData);
  EXPECT_EQ(code(401), ErrorCode::kUnauthenticated);
  EXPECT_EQ(code(403), ErrorCode::kPermissionDenied);
  EXPECT_EQ(code(429), ErrorCode::kRateLimited);
  EXPECT_EQ(code(507), ErrorCode::kDiskFull);
  EXPECT_EQ(code(500), ErrorCode::kInternal);
  EXPECT_EQ(code(503), ErrorCode::kUnavailable);
  EXPECT_EQ(code(418), ErrorCode::kInvalidArgument);
}

TEST(Problems, ACodeThatIsNotOfTheListLeavesItToTheStatus) {
  const Error error =
      problem_to_error(405, "application/problem+json; charset=utf-8",
                       R"({"code":"method-not-allowed","detail":"Allowed: GET"})", "");
  EXPECT_EQ(error.code(), ErrorCode::kUnsupported);
  EXPECT_STREQ(error.what(), "Allowed: GET");
}

}  // namespace
}  // namespace cellmap::client
