#include <array>
#include <cmath>
#include <string>

#include "cellmap/core/error.hpp"
#include "cellmap/simulation/simulator.hpp"

namespace cellmap {
namespace {

void require(bool holds, const std::string& expected) {
  if (!holds) throw Error(ErrorCode::kInvalidArgument, "LiDAR model: expected " + expected);
}

}  // namespace

LidarModel LidarModel::by_name(const std::string& name) {
  LidarModel model;
  model.name = name;
  if (name == "hdl64e") return model;
  if (name == "os1-64") {
    model.top_elevation_deg = 22.5;
    model.bottom_elevation_deg = -22.5;
    model.columns = 1024;
    model.range_noise_m = 0.03;
    model.mount_height_m = 1.8;
    return model;
  }
  if (name == "vlp16") {
    model.beams = 16;
    model.top_elevation_deg = 15.0;
    model.bottom_elevation_deg = -15.0;
    model.columns = 1800;
    model.max_range_m = 100.0;
    model.range_noise_m = 0.03;
    return model;
  }
  throw Error(ErrorCode::kInvalidArgument,
              "expected a LiDAR named hdl64e, os1-64 or vlp16, found \"" + name + "\"");
}

void LidarModel::validate() const {
  require(beams >= 1 && beams <= 256, "1 to 256 beams, found " + std::to_string(beams));
  require(columns >= 4 && columns <= 8192, "4 to 8192 columns, found " + std::to_string(columns));
  require(std::isfinite(top_elevation_deg) && std::isfinite(bottom_elevation_deg) &&
              bottom_elevation_deg >= -90 && top_elevation_deg <= 90 &&
              bottom_elevation_deg <= top_elevation_deg,
          "-90 <= bottom elevation <= top elevation <= 90 deg, found " +
              std::to_string(bottom_elevation_deg) + " and " + std::to_string(top_elevation_deg));
  require(rate_hz >= 0.1 && rate_hz <= 100,
          "a rate of 0.1 to 100 Hz, found " + std::to_string(rate_hz));
  require(max_range_m >= 5 && max_range_m <= 150,
          "a maximum range of 5 to 150 m, found " + std::to_string(max_range_m));
  require(grazing_range_m >= 0 && std::isfinite(grazing_range_m),
          "a grazing range of 0 m (off) or more, found " + std::to_string(grazing_range_m));
  require(range_noise_m >= 0 && range_noise_m <= 1,
          "a range noise of 0 to 1 m, found " + std::to_string(range_noise_m));
  require(drop_out >= 0 && drop_out < 1,
          "a drop-out share in [0, 1), found " + std::to_string(drop_out));
  require(mount_height_m >= 0.5 && mount_height_m <= 4,
          "a mounting height of 0.5 to 4 m, found " + std::to_string(mount_height_m));
}

}  // namespace cellmap
