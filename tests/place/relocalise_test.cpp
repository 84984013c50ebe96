#include "cellmap/place/relocalise.hpp"

#include <gtest/gtest.h>

#include <random>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/geometry/angle.hpp"
#include "cellmap/place/described_query.hpp"
#include "cellmap/place/place_part.hpp"
#include "cellmap/place/polar_image.hpp"
#include "support/expect_error.hpp"
#include "support/town_drive.hpp"

namespace cellmap {
namespace {

using test::BuiltMap;
using test::TownDrive;

/// The town driven once with perfect odometry: the map frame is the world, up to the first pose.
class RelocalisationInATown : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    map_ = std::make_unique<BuiltMap>();
    index_ = std::make_unique<PlaceIndex>();
    MapperOptions options = test::quick_mapper_options();
    options.bidirectional = options.loop_closures = false;
    const auto source = TownDrive{.laps = 0.9, .drift_deg_per_m = 0, .stretch = 1}.open();
    Mapper mapper(options, "drive", map_->lattice, {}, map_->access());
    build_map(*source, mapper, [&](CellUpdate&& update) {
      index_->add(update.id, *update.cell, *map_->lattice);
      map_->add(std::move(update));
    });
  }
  static void TearDownTestSuite() {
    map_.reset();
    index_.reset();
  }

  static RelocaliseOptions quick_options() {
    RelocaliseOptions options;
    options.search_points = 1'500;
    options.refine_points = 8'000;
    options.candidates = 6;
    return options;
  }

  /// The `number`-th scan of a drive along the same way through other traffic.
  static PointCloud scan_of_another_day(std::size_t number) {
    const auto source =
        TownDrive{.laps = 0.8, .drift_deg_per_m = 0, .stretch = 1, .traffic_seed = 5}.open();
    source->seek(number);
    return source->next()->points;
  }

  static RelocalisationAnswer relocalise(const PointCloud& scan,
                                         const std::optional<PosePrior>& prior = {}) {
    return index_->relocalise(scan, map_->graph, map_->provider(), prior, quick_options());
  }

  static void expect_right(const RelocalisationAnswer& answer, const Pose& truth) {
    ASSERT_TRUE(answer.found.has_value());
    const Pose& T = answer.found->T_map_scan;
    EXPECT_LT((T.translation() - truth.translation()).norm(), 0.2);
    EXPECT_LT(angle_between_rad(T, truth), 0.5 * kRadPerDeg);
  }

  static std::unique_ptr<BuiltMap> map_;
  static std::unique_ptr<PlaceIndex> index_;
};
std::unique_ptr<BuiltMap> RelocalisationInATown::map_;
std::unique_ptr<PlaceIndex> RelocalisationInATown::index_;

PointCloud turned(const PointCloud& scan, double yaw_rad) {
  return transformed(scan, upright_pose(0, 0, yaw_rad));
}

/// Another lane, other cars and any heading.
TEST_F(RelocalisationInATown, AScanOfAnotherDayIsFoundAtAnyHeading) {
  const auto source = TownDrive{.laps = 0.8,
                                .drift_deg_per_m = 0,
                                .stretch = 1,
                                .lateral_offset_m = 1.2,
                                .traffic_seed = 77}
                          .open();
  for (const std::size_t i : {10u, 31u, 52u, 67u}) {
    source->seek(i);
    const auto scan = source->next();
    const double yaw = 0.9 * static_cast<double>(i);
    const Pose truth = source->ground_truth()[i].pose * upright_pose(0, 0, -yaw);
    const PointCloud query = turned(scan->points, yaw);
    SCOPED_TRACE(i);

    expect_right(relocalise(query), truth);

    PosePrior prior;
    prior.T_map_scan = truth * upright_pose(1.4, -1.4, 10 * kRadPerDeg);
    const RelocalisationAnswer with_prior = relocalise(query, prior);
    expect_right(with_prior, truth);
    EXPECT_LT(with_prior.cells_considered, map_->graph.nodes.size());
  }
}

TEST_F(RelocalisationInATown, TheCovarianceIsPositiveAndAdmitsTheError) {
  const auto source =
      TownDrive{.laps = 0.8, .drift_deg_per_m = 0, .stretch = 1, .traffic_seed = 5}.open();
  source->seek(20);
  const auto scan = source->next();
  const RelocalisationAnswer answer = relocalise(scan->points);
  ASSERT_TRUE(answer.found.has_value());
  EXPECT_LT((answer.covariance - answer.covariance.transpose()).norm(), 1e-12);
  const Tangent error = log(source->ground_truth()[20].pose * answer.found->T_map_scan.inverse());
  // The 1 - 1e-6 quantile of chi-square with six degrees of freedom.
  EXPECT_LT(error.dot(answer.covariance.ldlt().solve(error)), 38.3);
}

TEST_F(RelocalisationInATown, AScanFromAnotherTownIsNotFound) {
  const auto source =
      TownDrive{.laps = 0.8, .drift_deg_per_m = 0, .stretch = 1, .seed = 900}.open();
  for (const std::size_t i : {5u, 25u, 45u, 60u}) {
    source->seek(i);
    const auto scan = source->next();
    const RelocalisationAnswer answer = relocalise(scan->points);
    EXPECT_FALSE(answer.found.has_value()) << i;
    EXPECT_FALSE(answer.alternatives.empty());
    for (const auto& alternative : answer.alternatives) EXPECT_FALSE(alternative.accepted);
  }
}

/// A town that nothing was fitted on. Of wrong poses the one that agrees best is asked about.
TEST_F(RelocalisationInATown, TheCellsAroundTellRightPosesFromWrongOnes) {
  const auto agreement_at = [](const PointCloud& scan, const Pose& T_map_scan) {
    std::vector<CellAround> around;
    for (const auto& [id, T] : map_->graph.nodes) {
      if ((T.translation() - T_map_scan.translation()).norm() > 25) continue;
      around.push_back({map_->provider()(id), T});
    }
    EXPECT_GE(around.size(), 3u);
    return agreement(score_surroundings(around, ScanView(thinned(scan, 10'000)),
                                        thinned(scan, 2'000), T_map_scan,
                                        default_place_registration()));
  };
  const auto source =
      TownDrive{.laps = 0.8, .drift_deg_per_m = 0, .stretch = 1, .traffic_seed = 5}.open();
  const auto elsewhere =
      TownDrive{.laps = 0.8, .drift_deg_per_m = 0, .stretch = 1, .seed = 900}.open();
  for (const std::size_t i : {12u, 35u, 58u}) {
    SCOPED_TRACE(i);
    source->seek(i);
    const PointCloud scan = source->next()->points;
    const Pose truth = source->ground_truth()[i].pose;
    EXPECT_GT(agreement_at(scan, truth), 0.73);
    EXPECT_LT(agreement_at(scan, truth * upright_pose(5, 0, 0)), 0.68);
    elsewhere->seek(i);
    EXPECT_LT(agreement_at(elsewhere->next()->points, truth), 0.68);
  }
}

TEST_F(RelocalisationInATown, NoAnswerLiesOutsideThePrior) {
  const auto source =
      TownDrive{.laps = 0.8, .drift_deg_per_m = 0, .stretch = 1, .traffic_seed = 5}.open();
  source->seek(20);
  const auto scan = source->next();
  PosePrior prior;
  prior.T_map_scan = source->ground_truth()[50].pose;
  prior.radius_m = 5;
  EXPECT_FALSE(relocalise(scan->points, prior).found.has_value());
}

TEST_F(RelocalisationInATown, ASensorThatLeansBy10DegreesIsFound) {
  const auto source =
      TownDrive{.laps = 0.8, .drift_deg_per_m = 0, .stretch = 1, .traffic_seed = 5}.open();
  source->seek(33);
  const auto scan = source->next();
  Pose T_upright_sensor = upright_pose(0, 0, 2.0);
  T_upright_sensor.rotate(Eigen::AngleAxisd(10 * kRadPerDeg, Eigen::Vector3d(0.6, 0.8, 0)));
  expect_right(relocalise(transformed(scan->points, T_upright_sensor.inverse())),
               source->ground_truth()[33].pose * T_upright_sensor);
}

TEST_F(RelocalisationInATown, ScansWithOdometryAndABuiltCellAreQueriesToo) {
  const auto source =
      TownDrive{.laps = 0.8, .drift_deg_per_m = 0, .stretch = 1, .traffic_seed = 5}.open();
  std::vector<PosedScan> scans;
  for (source->seek(24); scans.size() < 4;) scans.push_back(*source->next());
  expect_right(index_->relocalise(RelocalisationQuery::from_scans(scans), map_->graph,
                                  map_->provider(), quick_options()),
               source->ground_truth()[27].pose);

  LocalMap local(Scan{0, scans[0].points}, scans[0].T_odom_sensor, 0);
  for (std::size_t i = 1; i < scans.size(); ++i) {
    local.add(Scan{static_cast<Stamp>(i), scans[i].points}, scans[i].T_odom_sensor);
  }
  const Cell cell = build_cell(local, *map_->lattice, {});
  const RelocalisationQuery query = RelocalisationQuery::from_cell(cell, *map_->lattice);
  const auto answer = index_->relocalise(query, map_->graph, map_->provider(), quick_options());
  expect_right(answer, source->ground_truth()[24].pose);
  EXPECT_GT(answer.found->structure.facing_ratio, 0.5);
}

TEST_F(RelocalisationInATown, TheEvidenceAddsUp) {
  const auto answer = relocalise(scan_of_another_day(20));
  ASSERT_TRUE(answer.found.has_value());
  EXPECT_GE(answer.found->confidence, quick_options().min_confidence);
  std::uint32_t points = 0;
  for (const std::uint32_t n : answer.found->residuals.points) points += n;
  EXPECT_EQ(points, answer.found->registration.scores.hits);
  for (const auto& other : answer.alternatives) {
    EXPECT_LE(other.confidence, answer.found->confidence);
  }
}

TEST_F(RelocalisationInATown, TheAnswerDoesNotDependOnTheThreadCount) {
  const PointCloud scan = scan_of_another_day(40);
  RelocaliseOptions options = quick_options();
  const auto one = index_->relocalise(scan, map_->graph, map_->provider(), {}, options);
  options.threads = 2;
  const auto two = index_->relocalise(scan, map_->graph, map_->provider(), {}, options);
  ASSERT_TRUE(one.found && two.found);
  EXPECT_EQ(one.found->T_map_scan.matrix(), two.found->T_map_scan.matrix());
}

TEST_F(RelocalisationInATown, OthersHaveTheProcessorBetweenSmallPieces) {
  const PointCloud scan = scan_of_another_day(40);
  RelocaliseOptions options = quick_options();
  const auto alone = index_->relocalise(scan, map_->graph, map_->provider(), {}, options);
  std::size_t times = 0;
  options.registration.give_way = GiveWay([&] { ++times; });
  const auto kind = index_->relocalise(scan, map_->graph, map_->provider(), {}, options);
  ASSERT_TRUE(alone.found && kind.found);
  EXPECT_EQ(alone.found->T_map_scan.matrix(), kind.found->T_map_scan.matrix());
  // Once for every view of the query, every CELL and every iteration, of which the answer's are
  // few.
  EXPECT_GT(times, QueryViews::kViews + kind.cells_considered +
                       static_cast<std::size_t>(kind.found->registration.iterations));
}

/// Parts of the CELLs of the town, which lies around the corner of four regions.
class TownInParts : public PlaceParts {
 public:
  TownInParts(const BuiltMap& map, std::shared_ptr<const PlaceRegions> regions)
      : map_(map), regions_(std::move(regions)) {}
  std::shared_ptr<const PlacePart> part(const RegionKey& region) const override {
    asked.push_back(region);
    auto part = std::make_shared<PlacePart>();
    for (const CellId id : regions_->find(region)->ids) {
      part->put(id, describe_place(reconstruct_points(map_.targets.at(id)->cell(), *map_.lattice)));
    }
    return part;
  }
  bool is_at_hand(const RegionKey&) const override { return false; }
  mutable std::vector<RegionKey> asked;

 private:
  const BuiltMap& map_;
  std::shared_ptr<const PlaceRegions> regions_;
};

TEST_F(RelocalisationInATown, AnIndexInPartsAnswersAsOneThatIsWhole) {
  PoseGraph graph = map_->graph;
  for (auto& [id, T] : graph.nodes) T = upright_pose(0, -22, 0) * T;  // its middle on the corner
  const auto regions = std::make_shared<const PlaceRegions>(graph);
  ASSERT_EQ(regions->all().size(), 4u);
  const auto parts = std::make_shared<TownInParts>(*map_, regions);
  const PlaceIndex in_parts(regions, std::make_shared<PartsSearcher>(parts));
  EXPECT_EQ(in_parts.size(), index_->size());
  const auto source =
      TownDrive{.laps = 0.8, .drift_deg_per_m = 0, .stretch = 1, .traffic_seed = 77}.open();
  for (const std::size_t i : {10u, 31u, 67u}) {
    source->seek(i);
    const PointCloud scan = source->next()->points;
    PosePrior prior;
    prior.T_map_scan = upright_pose(0, -22, 0) * source->ground_truth()[i].pose;
    prior.radius_m = 1;
    for (const auto& known : {std::optional<PosePrior>(), std::optional<PosePrior>(prior)}) {
      const auto expected =
          index_->relocalise(scan, graph, map_->provider(), known, quick_options());
      parts->asked.clear();
      const auto answer =
          in_parts.relocalise(scan, graph, map_->provider(), known, quick_options());
      ASSERT_TRUE(answer.found && expected.found) << i;
      EXPECT_EQ(answer.found->cell, expected.found->cell);
      EXPECT_EQ(answer.found->T_map_scan.matrix(), expected.found->T_map_scan.matrix());
      EXPECT_EQ(answer.found->confidence, expected.found->confidence);
      EXPECT_EQ(answer.cells_considered, expected.cells_considered);
      ASSERT_EQ(answer.alternatives.size(), expected.alternatives.size());
      for (std::size_t k = 0; k < answer.alternatives.size(); ++k) {
        EXPECT_EQ(answer.alternatives[k].cell, expected.alternatives[k].cell);
      }
      EXPECT_EQ(parts->asked.size() < 4, known.has_value());
    }
  }
}

TEST_F(RelocalisationInATown, PointsThatAreNoPointsAreIgnored) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  PointCloud scan;
  EXPECT_FALSE(relocalise(scan).found.has_value());
  for (int i = 0; i < 500; ++i) scan.push_back({nan, 1, 1});
  EXPECT_FALSE(relocalise(scan).found.has_value());
}

TEST(PlaceIndex, AnEmptyIndexFindsNothing) {
  PlaceIndex index;
  PointCloud scan;
  for (int i = 0; i < 1000; ++i) scan.push_back({5.0f + 0.01f * static_cast<float>(i), 1, 1});
  const auto answer = index.relocalise(
      scan, {}, [](CellId) { return std::shared_ptr<const RegistrationTarget>(); }, {}, {});
  EXPECT_FALSE(answer.found.has_value());
  EXPECT_EQ(answer.cells_considered, 0u);
}

TEST(PlaceIndex, APriorThatIsNoPriorIsRefused) {
  PlaceIndex index;
  PosePrior prior;
  prior.radius_m = -1;
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { index.relocalise({}, {}, {}, prior, {}); }, "radius_m");
}

TEST(PosePrior, FromACovarianceReachesItsSigmasAtTheScan) {
  const Pose T = upright_pose(100, 0, 0.3);
  Matrix6d covariance = 1e-6 * Matrix6d::Identity();
  covariance(0, 0) = 4.0;     // 2 m along x
  covariance(5, 5) = 0.0025;  // 0.05 rad: 5 m at a distance of 100 m
  const PosePrior prior = prior_from_covariance(T, covariance, 3.0);
  EXPECT_NEAR(prior.radius_m, 15.0, 0.01);
  EXPECT_NEAR(prior.yaw_range_rad, 0.15, 1e-9);
  EXPECT_EQ(prior.T_map_scan.matrix(), T.matrix());
  covariance(1, 1) = -1;
  test::expect_error(
      ErrorCode::kInvalidArgument, [&] { prior_from_covariance(T, covariance); }, "covariance");
}

TEST(PolarImage, CorrelationPeaksAtTheTurnBetweenTwoViews) {
  std::mt19937 rng(1);
  std::uniform_real_distribution<float> xy(-60, 60), z(-2, 6);
  PointCloud points;
  for (int i = 0; i < 3000; ++i) points.push_back({xy(rng), xy(rng), z(rng)});
  const PolarImage image(points);
  for (const int sectors : {0, 7, 45}) {
    const PolarImage seen(turned(points, -sectors * 6 * kRadPerDeg));
    const std::vector<float> agreement = image.correlate(seen);
    const auto peak = std::max_element(agreement.begin(), agreement.end());
    EXPECT_EQ(peak - agreement.begin(), sectors);
    EXPECT_GT(*peak, 0.9f);
  }
}

TEST(RecentredImages, FindWhereTheScanStandsBesideTheOrigin) {
  std::mt19937 rng(2);
  std::uniform_real_distribution<float> xy(-60, 60), z(-2, 6);
  PointCloud cell;
  for (int i = 0; i < 3000; ++i) cell.push_back({xy(rng), xy(rng), z(rng)});
  const Pose T_cell_scan = upright_pose(2, -2, 54 * kRadPerDeg);
  const RecentredImages query(transformed(cell, T_cell_scan.inverse()));
  const auto found = query.align(PolarImage(cell), 3);
  ASSERT_FALSE(found.empty());
  EXPECT_LT((found[0].T_cell_scan.translation() - T_cell_scan.translation()).norm(), 1.5);
  EXPECT_LT(angle_between_rad(found[0].T_cell_scan, T_cell_scan), 6.1 * kRadPerDeg);
}

}  // namespace
}  // namespace cellmap
