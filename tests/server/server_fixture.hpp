#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/scan_codec.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "server/api/api.hpp"
#include "server/openapi_text.hpp"
#include "support/box_scene.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::server::test {

inline constexpr const char* kCell1 = "/v1/maps/town/cells/1";
inline constexpr const char* kCoded = "application/vnd.cellmap.coded-cell";

using cellmap::test::level_pose;

/// A drive along the analytic street in steps of a metre, thin enough for tests to take
/// milliseconds.
inline PosedScan street_scan(std::size_t index) {
  static const auto kScene = cellmap::test::street();
  cellmap::test::BoxScene::Sensor sensor;
  sensor.beams = 24;
  sensor.azimuths = 300;
  PosedScan scan;
  scan.index = index;
  scan.stamp = static_cast<Stamp>(index) * 100'000'000;
  scan.T_odom_sensor = level_pose(static_cast<double>(index), 0, 0);
  scan.points = kScene.scan(scan.T_odom_sensor, sensor);
  return scan;
}

inline std::string to_text(const Bytes& bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// The bytes of a KITTI .bin file.
inline std::string kitti_bytes(const PointCloud& points) {
  std::string bytes;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float values[4] = {points.x[i], points.y[i], points.z[i], 0};
    bytes.append(reinterpret_cast<const char*>(values), sizeof(values));
  }
  return bytes;
}

/// Writes the first scans of the street as a KITTI folder with poses of the sensor.
inline void write_drive(const std::filesystem::path& folder, std::size_t scans) {
  std::filesystem::create_directories(folder / "velodyne");
  std::ofstream times(folder / "times.txt"), poses(folder / "poses.txt");
  for (std::size_t i = 0; i < scans; ++i) {
    const PosedScan scan = street_scan(i);
    std::string name = std::to_string(i);
    name.insert(0, 6 - name.size(), '0');
    std::ofstream(folder / "velodyne" / (name + ".bin"), std::ios::binary)
        << kitti_bytes(scan.points);
    times << 0.1 * static_cast<double>(i) << '\n';
    poses << "1 0 0 " << i << " 0 1 0 0 0 0 1 0\n";
  }
}

inline constexpr LatticeSpec kLattice{LatticeKind::kFibonacci, 6000};

/// The CELL of one scan of the street.
inline EncodedCell street_cell(std::uint32_t sequence, std::size_t scan_index,
                               const std::string& session = "drive") {
  const PosedScan posed = street_scan(scan_index);
  const LocalMap local_map(filter_scan(posed.points, posed.stamp, {}), posed.T_odom_sensor,
                           static_cast<std::uint32_t>(scan_index));
  Cell cell = build_cell(local_map, Lattice(kLattice), {});
  cell.session = session;
  cell.sequence = sequence;
  return encode_cell(cell);
}

struct Headed {
  Headed(std::string_view name_in, std::string_view value_in) : name(name_in), value(value_in) {}
  std::string name, value;
};

/// An API on a real store in a folder of its own, called without a socket.
class ApiTest : public ::testing::Test {
 protected:
  ApiTest() { start(); }

  ApiOptions options() const {
    ApiOptions options;
    options.openapi = openapi_text();
    options.threads = 1;
    options.heartbeat = std::chrono::milliseconds(50);
    std::filesystem::create_directories(folder_.path() / "data");
    options.jobs.data_roots = {std::filesystem::canonical(folder_.path() / "data")};
    return options;
  }

  void start() { start(options()); }
  void start(ApiOptions options) {
    stop();
    store_ = open_sqlite_store(folder_.path() / "store.db");
    api_ = std::make_unique<Api>(*store_, std::move(options));
  }
  void stop() {
    api_.reset();
    store_.reset();
  }

  Response send(const std::string& method, const std::string& target, std::string body = {},
                const std::vector<Headed>& headers = {}) {
    Request request{method, target, {}, std::move(body), "test"};
    for (const auto& [name, value] : headers) request.headers.set(name, value);
    Response response = api_->handle(request);
    record(request, response);
    return response;
  }
  Response get(const std::string& target, const std::vector<Headed>& headers = {}) {
    return send("GET", target, {}, headers);
  }
  Response post(const std::string& target, const std::string& json) {
    return send("POST", target, json, {{"Content-Type", "application/json"}});
  }
  Response patch(const std::string& target, const std::string& json) {
    return send("PATCH", target, json, {{"Content-Type", "application/json"}});
  }

  static Json json_of(const Response& response) { return Json::parse(body_view(response)); }

  /// Expects a problem document of this status and code; returns its detail.
  std::string expect_problem(const Response& response, int status, const std::string& code) {
    EXPECT_EQ(response.status, status) << body_view(response);
    EXPECT_EQ(response.headers.get("Content-Type"), "application/problem+json");
    if (response.status < 400) return {};
    const Json json = json_of(response);
    EXPECT_EQ(json.value("code", ""), code);
    EXPECT_EQ(json.value("status", 0), status);
    return json.value("detail", "");
  }

  void make_map(const std::string& name = "town") {
    const auto response = post(
        "/v1/maps", R"({"name":")" + name + R"(","lattice":{"kind":"fibonacci","size":6000}})");
    ASSERT_EQ(response.status, 201) << body_view(response);
  }

  Response put_cell(std::uint32_t id, const EncodedCell& cell, std::vector<Headed> headers = {}) {
    headers.push_back({"Content-Type", "application/vnd.cellmap.cell"});
    return send("PUT", "/v1/maps/town/cells/" + std::to_string(id), to_text(cell.bytes), headers);
  }

  /// CELLs 1, 2, ... of the street, `step` metres apart.
  void put_street(std::uint32_t cells, std::size_t step = 6) {
    for (std::uint32_t i = 0; i < cells; ++i) {
      const auto response = put_cell(i + 1, street_cell(i, i * step));
      ASSERT_EQ(response.status, 201) << body_view(response);
    }
  }

  /// Waits for the job to end and returns it.
  Json ended_job(const Json& job) {
    const std::string target = "/v1/jobs/" + job.at("id").dump();
    for (int i = 0; i < 3000; ++i) {
      Json now = Json::parse(body_view(api_->handle({"GET", target, {}, {}, "poll"})));
      if (now.at("state") != "queued" && now.at("state") != "running") return now;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    ADD_FAILURE() << "the job did not end";
    return job;
  }

  cellmap::test::TempFolder folder_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<Api> api_;

 private:
  /// For check_openapi.py, which holds every answer against schema/openapi.yaml.
  static void record(const Request& request, const Response& response) {
    const char* file = std::getenv("CELLMAP_RECORD");
    if (!file) return;
    Json json{{"method", request.method}, {"target", request.target}, {"status", response.status}};
    json["headers"] = Json::object();
    for (const auto& [name, value] : response.headers.fields()) {
      json["headers"][std::string(name)] = value;
    }
    json["request_type"] = request.headers.get("Content-Type").value_or("");
    const auto type = response.headers.get("Content-Type").value_or("");
    const bool readable = !response.headers.get("Content-Encoding");
    if (readable && type.find("json") != std::string::npos) json["body"] = body_view(response);
    if (json["request_type"] == "application/json") json["request_body"] = request.body;
    std::ofstream(file, std::ios::app) << dump(json) << '\n';
  }
};

}  // namespace cellmap::server::test
