#include <limits>

#include "cellmap/codec/scan_batch.hpp"
#include "cellmap/codec/zstd.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kRelocalise = "/v1/maps/town/relocalise";

class ApiRelocalise : public ApiTest {
 protected:
  ApiRelocalise() {
    make_map();
    put_street(4);
  }

  Response ask(const std::string& query, const std::string& body,
               const std::string& type = "application/octet-stream") {
    return send("POST", kRelocalise + query, body, {{"Content-Type", type}});
  }

  /// A scan of the street that no CELL was built from.
  static PointCloud new_scan(const Pose& T_map_scan) {
    cellmap::test::BoxScene::Sensor sensor;
    sensor.beams = 24;
    sensor.azimuths = 300;
    return cellmap::test::street().scan(T_map_scan, sensor);
  }
};

TEST_F(ApiRelocalise, AScanOfTheMapIsFoundNearAPriorInBothForms) {
  const Pose truth = level_pose(8, 0.4, 4);
  PosedScan scan;
  scan.points = new_scan(truth);
  const std::string query = "?prior=9,0,0,0,0,0,1&radius=3";
  for (const auto& answer :
       {ask(query, kitti_bytes(scan.points)),
        ask(query, to_text(encode_scan(scan)), "application/vnd.cellmap.scan")}) {
    ASSERT_EQ(answer.status, 200) << body_view(answer);
    const Json json = json_of(answer);
    ASSERT_TRUE(json["found"]) << body_view(answer);
    EXPECT_NEAR(json["T_map_scan"][0], 8, 0.1);
    EXPECT_NEAR(json["T_map_scan"][1], 0.4, 0.1);
    EXPECT_EQ(json["covariance"].size(), 21u);
    EXPECT_EQ(json["revision"], 4);
  }
}

TEST_F(ApiRelocalise, AScanIsFoundWithoutAPrior) {
  const Json json = json_of(ask("", kitti_bytes(new_scan(level_pose(7, 0.2, 90)))));
  ASSERT_TRUE(json["found"]) << json.dump();
  EXPECT_NEAR(json["T_map_scan"][0], 7, 0.2);
  EXPECT_EQ(json["cells_considered"], 4);
}

TEST_F(ApiRelocalise, AScanOfAnotherPlaceIsHonestlyNotFound) {
  cellmap::test::BoxScene hall;
  hall.add({-40, -3, -2}, {3, 30, 9});
  const Json json = json_of(ask("", kitti_bytes(hall.scan(level_pose(0, 0, 0)))));
  EXPECT_FALSE(json["found"]);
  EXPECT_FALSE(json.contains("T_map_scan"));
  for (const auto& other : json["alternatives"]) EXPECT_FALSE(other["accepted"]);
}

TEST_F(ApiRelocalise, SeveralScansWithOdometryAskForThePoseOfTheLast) {
  Bytes batch;
  for (int i = 0; i < 3; ++i) {
    PosedScan scan;
    scan.index = static_cast<std::size_t>(i);
    scan.T_odom_sensor = level_pose(100 + i, 50, 0);  // in a frame of its own
    scan.points = new_scan(level_pose(6 + i, 0.2, 0));
    append_to_scan_batch(batch, scan);
  }
  const Json json = json_of(ask("", to_text(batch), "application/vnd.cellmap.scans"));
  ASSERT_TRUE(json["found"]) << json.dump();
  EXPECT_NEAR(json["T_map_scan"][0], 8, 0.2);
  expect_problem(ask("", "junk", "application/vnd.cellmap.scans"), 422, "corrupt-data");
}

TEST_F(ApiRelocalise, APriorMayComeWithACovariance) {
  const std::string scan = kitti_bytes(new_scan(level_pose(8, 0.4, 4)));
  const auto around = [](double y, double sigma_m) {
    const std::string variance = std::to_string(sigma_m * sigma_m);
    return "?prior=9," + std::to_string(y) + ",0,0,0,0,1&prior_covariance=" + variance +
           ",0,0,0,0,0," + variance + ",0,0,0,0," + variance + ",0,0,0,0.01,0,0,0.01,0,0.01";
  };
  EXPECT_TRUE(json_of(ask(around(0, 1), scan))["found"]);
  EXPECT_FALSE(json_of(ask(around(9, 0.5), scan))["found"]) << "it is not where the prior allows";
  expect_problem(ask(around(0, 1) + "&radius=3", scan), 400, "invalid-argument");
  expect_problem(ask("?prior_covariance=1,2", scan), 400, "invalid-argument");
  expect_problem(ask("?prior=9,0,0,0,0,0,1&prior_covariance=" + std::string("0,0,0,0,0,0,") +
                         "0,0,0,0,0,0,0,0,0,0,0,0,0,0,0",
                     scan),
                 400, "invalid-argument");
}

TEST_F(ApiRelocalise, EveryPlaceComesWithItsEvidence) {
  const Json json = json_of(ask("", kitti_bytes(new_scan(level_pose(7, 0.2, 90)))));
  ASSERT_TRUE(json["found"]);
  EXPECT_GE(json["confidence"], 0.5);
  std::uint64_t points = 0;
  for (const auto& count : json["residuals"]["points"]) points += count.get<std::uint64_t>();
  EXPECT_EQ(json["residuals"]["points"].size(), json["residuals"]["borders_m"].size() + 1);
  EXPECT_GT(points, 100u);
}

TEST_F(ApiRelocalise, AnEmptyMapFindsNothing) {
  post("/v1/maps", R"({"name":"empty"})");
  const auto answer = send("POST", "/v1/maps/empty/relocalise", kitti_bytes(street_scan(0).points),
                           {{"Content-Type", "application/octet-stream"}});
  ASSERT_EQ(answer.status, 200) << body_view(answer);
  EXPECT_FALSE(json_of(answer)["found"]);
}

TEST_F(ApiRelocalise, WrongScansAndPriorsAreRefused) {
  const std::string good = kitti_bytes(street_scan(0).points);
  expect_problem(ask("", good.substr(0, 100)), 422, "corrupt-data");
  expect_problem(ask("", "junk", "application/vnd.cellmap.scan"), 422, "corrupt-data");
  expect_problem(ask("", ""), 400, "invalid-argument");
  PointCloud nans;
  nans.push_back({std::numeric_limits<float>::quiet_NaN(), 0, 0});
  expect_problem(ask("", kitti_bytes(nans)), 400, "invalid-argument");
  expect_problem(ask("", good, "text/plain"), 415, "unsupported");
  expect_problem(ask("?prior=0,0,0,0,0,0,nan", good), 400, "invalid-argument");
  expect_problem(ask("?prior=0,0,0,0,0,0,5", good), 400, "invalid-argument");
  expect_problem(ask("?prior=1,2,3", good), 400, "invalid-argument");
  expect_problem(ask("?radius=5", good), 400, "invalid-argument");
  expect_problem(ask("?prior=0,0,0,0,0,0,1&radius=0", good), 400, "invalid-argument");
  expect_problem(ask("", std::string(34u << 20, '\0')), 413, "too-large");
  expect_problem(send("POST", "/v1/maps/none/relocalise", good,
                      {{"Content-Type", "application/octet-stream"}}),
                 404, "not-found");
}

TEST_F(ApiRelocalise, TooManyAtATimeAreTurnedAway) {
  ApiOptions none = options();
  none.relocalisations = 0;
  none.relocalisation_wait = std::chrono::milliseconds(1);
  start(none);
  const auto refused = ask("", kitti_bytes(street_scan(0).points));
  expect_problem(refused, 503, "unavailable");
  EXPECT_TRUE(refused.headers.get("Retry-After"));
}

}  // namespace
}  // namespace cellmap::server::test
