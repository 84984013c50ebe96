#include "cellmap/evaluation/comparison.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "cellmap/evaluation/held_back_registration.hpp"
#include "cellmap/evaluation/point_registration.hpp"
#include "support/expect_error.hpp"
#include "support/street_drive.hpp"
#include "support/temp_folder.hpp"

namespace cellmap {
namespace {

using nlohmann::json;
using test::street_drive;

ComparisonOptions quick_options() {
  ComparisonOptions options;
  options.samples = 3'000;
  options.registration_points = 3'000;
  options.starts = 1;
  return options;
}

std::vector<Representation> some_rows() {
  return {raw_points(), voxel_points(0.4),
          cells(compact_form(0.02), 6, {}, {LatticeKind::kFibonacci, 20'000})};
}

Comparison compare_street(int threads) {
  const test::TempFolder folder;
  ComparisonOptions options = quick_options();
  options.threads = threads;
  return compare(street_drive(10, 2), some_rows(), options, folder.path());
}

/// Without what depends on the machine.
json without_times(const Comparison& comparison) {
  json all = json::parse(to_json(comparison));
  for (json& row : all["rows"]) {
    row.erase("encode_s");
    row.erase("decode_s");
  }
  return all;
}

TEST(PointRegistration, FindsTheScanAgainOnTheStreet) {
  const ComparedDrive drive = street_drive(6, 1);
  const PointTarget target(voxel_means(stacked_points(drive), 0.1), {}, 1);
  const PlacedScan& held = drive.held_back.front();
  Tangent off;
  off << 0.3, -0.2, 0.05, 0.01, 0, 0.02;
  const PointCloud scan = every_nth(held.scan.points, 3);
  const RegistrationResult result = register_to_points(target, scan, exp(off) * held.T_map_scan);
  const Pose error = held.T_map_scan.inverse() * result.T_target_source;
  EXPECT_LT(error.translation().norm(), 0.02);
  EXPECT_LT(angle_between_rad(error, Pose::Identity()), 0.002);
}

TEST(PointRegistration, EstimatesTheNormalOfAPlane) {
  PointCloud points;
  const Eigen::Vector3d normal = Eigen::Vector3d(1, 2, 3).normalized();
  const Eigen::Vector3d side = normal.unitOrthogonal(), up = normal.cross(side);
  for (int i = -5; i <= 5; ++i) {
    for (int k = -5; k <= 5; ++k) points.push_back((0.1 * (i * side + k * up)).cast<float>());
  }
  const PointCloud normals = estimate_normals(points, 12, 1);
  for (std::size_t i = 0; i < normals.size(); ++i) {
    EXPECT_NEAR(std::abs(normals[i].cast<double>().dot(normal)), 1, 1e-5);
  }
}

TEST(PointRegistration, ToNothingStaysWhereItBegan) {
  const PointTarget target({}, {}, 1);
  const RegistrationResult result = register_to_points(target, {}, Pose::Identity());
  EXPECT_FALSE(result.converged);
  EXPECT_TRUE(result.T_target_source.isApprox(Pose::Identity()));
}

TEST(HeldBackScans, AreFarOffInAMapOfAnotherPlace) {
  const ComparedDrive drive = street_drive(6, 1);
  DecodedMap elsewhere;
  elsewhere.points = voxel_means(stacked_points(drive), 0.4);
  for (float& x : elsewhere.points.x) x += 500;
  const HeldBackErrors errors = register_held_back(drive, elsewhere, quick_options());
  EXPECT_EQ(errors.registrations, 1u);
  // Nothing within reach: the start stays, 0.3 m and 1 deg off.
  EXPECT_GT(errors.points_m, 0.2);
  EXPECT_NEAR(errors.origin_m, 0.3, 1e-9);
  EXPECT_NEAR(errors.turn_deg, 1.0, 1e-6);
}

TEST(Comparison, MeasuresWhatIsWrittenToTheDisk) {
  const test::TempFolder folder;
  const ComparedDrive drive = street_drive(6, 1);
  const Comparison comparison = compare(drive, {raw_points()}, quick_options(), folder.path());
  const auto size = std::filesystem::file_size(folder.path() / "raw-points" / "points.pcd");
  ASSERT_EQ(comparison.rows.size(), 1u);
  EXPECT_EQ(comparison.rows[0].bytes, size);
  EXPECT_DOUBLE_EQ(comparison.rows[0].bytes_per_m, static_cast<double>(size) / drive.length_m);
  EXPECT_GT(size, 12 * stacked_points(drive).size());
}

TEST(Comparison, FindsRawPointsExactAndAllRowsNearTheTruth) {
  const Comparison comparison = compare_street(1);
  ASSERT_EQ(comparison.rows.size(), 3u);
  EXPECT_EQ(comparison.rows[0].reconstruction.accuracy_m, 0);
  EXPECT_EQ(comparison.rows[0].reconstruction.completeness_m, 0);
  EXPECT_EQ(comparison.rows[0].reconstruction.f_score[0], 1);
  for (const ComparisonRow& row : comparison.rows) {
    EXPECT_EQ(row.failed, 0u) << row.name;
    EXPECT_LT(row.registration_error_m, 0.05) << row.name;
    EXPECT_GT(row.registration_error_m, 0) << row.name;
  }
  // A mean of a voxel lies up to half its diagonal from any of its points.
  EXPECT_LT(comparison.rows[1].reconstruction.completeness_m, 0.35);
}

TEST(Comparison, DoesNotDependOnThreadsButForTimes) {
  EXPECT_EQ(without_times(compare_street(1)), without_times(compare_street(4)));
}

TEST(Comparison, ThatWasStoppedIsCancelled) {
  std::stop_source stop;
  stop.request_stop();
  const test::TempFolder folder;
  test::expect_error(ErrorCode::kCancelled, [&] {
    compare(street_drive(4, 1), some_rows(), quick_options(), folder.path(), stop.get_token());
  });
}

TEST(Comparison, OptionsNameWhatIsOutOfRange) {
  ComparisonOptions options;
  options.starts = 0;
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { options.validate(); }, "starts");
}

Comparison by_hand() {
  Comparison comparison;
  comparison.dataset = "<drive> & \"more\"";
  comparison.length_m = 50;
  ComparisonRow row;
  row.name = "CELLs, compact, 20 mm";
  row.bytes = 1'000;
  row.bytes_per_m = 20;
  row.planes = 400;
  row.registration_error_m = 0.01;
  row.reconstruction = {0.01, 0.02, {0.5, 0.6, 0.7}};
  comparison.rows = {row, published_row({"neural", "somebody", 27'000}),
                     missing_row("mesh", "not built in")};
  return comparison;
}

TEST(ComparisonJson, HasTheKeysThatOthersRead) {
  const json all = json::parse(to_json(by_hand()));
  const json row = all["rows"][0];
  for (const char* key :
       {"name", "measured", "bytes", "bytes_per_m", "bytes_per_plane", "accuracy_m",
        "completeness_m", "f_score", "registration_error_m", "encode_s", "decode_s"}) {
    EXPECT_TRUE(row.contains(key)) << key;
  }
  EXPECT_EQ(row["bytes_per_plane"], 2.5);
  EXPECT_EQ(row["f_score"], (json{{"0.05", 0.5}, {"0.1", 0.6}, {"0.2", 0.7}}));
}

TEST(ComparisonJson, LeavesEmptyWhatWasNotMeasured) {
  const json rows = json::parse(to_json(by_hand()))["rows"];
  EXPECT_EQ(rows[1]["measured"], false);
  EXPECT_EQ(rows[1]["bytes_per_m"], 27'000);
  EXPECT_TRUE(rows[2]["bytes_per_m"].is_null());
  for (const char* key : {"bytes", "accuracy_m", "completeness_m", "registration_error_m",
                          "encode_s", "decode_s", "bytes_per_plane"}) {
    EXPECT_TRUE(rows[1][key].is_null()) << key;
  }
  EXPECT_TRUE(rows[1]["f_score"]["0.1"].is_null());
}

TEST(ComparisonHtml, NeedsNothingButItself) {
  const std::string html = to_html(by_hand());
  for (const char* outside : {"http", "src=", "href", "url(", "@import", "<script"}) {
    EXPECT_EQ(html.find(outside), std::string::npos) << outside;
  }
  EXPECT_NE(html.find("prefers-color-scheme: dark"), std::string::npos);
  EXPECT_NE(html.find("<svg"), std::string::npos);
}

TEST(ComparisonHtml, EscapesNames) {
  const std::string html = to_html(by_hand());
  EXPECT_NE(html.find("&lt;drive&gt; &amp; &quot;more&quot;"), std::string::npos);
  EXPECT_EQ(html.find("<drive>"), std::string::npos);
}

TEST(ComparisonTable, HasALineForEachRow) {
  const std::string table = to_table(by_hand());
  for (const char* part :
       {"CELLs, compact, 20 mm", "2.50", "published: somebody", "not built in"}) {
    EXPECT_NE(table.find(part), std::string::npos) << part;
  }
}

}  // namespace
}  // namespace cellmap
