#include "cellmap/document/change_json.hpp"

#include <nlohmann/json.hpp>

namespace cellmap::document {
namespace {

Json to_json(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

}  // namespace

Json to_json(const ChangeRegion& region) {
  Json cells = Json::array();
  for (const CellId id : region.cells) cells.push_back(id.value);
  return {{"change", to_string(region.change)}, {"centroid", to_json(region.centroid)},
          {"min", to_json(region.box.min())},   {"max", to_json(region.box.max())},
          {"patches", region.patches},          {"area_m2", region.area_m2},
          {"cells", std::move(cells)}};
}

}  // namespace cellmap::document
