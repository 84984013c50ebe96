#include "cellmap/map/georeference.hpp"

#include "cellmap/core/error.hpp"
#include "server/api/api.hpp"

// /v1/maps/{map}/georeference.

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxGeoreferenceBody = 16u << 10;

/// The quaternion goes the way of a pose, which checks and normalises it.
Georeference read_georeference(const Json& json) {
  ObjectReader reader(json, "the georeference");
  Georeference georeference;
  const auto latitude = reader.number("latitude_deg"), longitude = reader.number("longitude_deg");
  const auto height = reader.number("height_m");
  const auto rotation = reader.numbers("q_enu_map", 4);
  reader.finish();
  if (!latitude || !longitude || !height || !rotation) {
    throw Error(
        ErrorCode::kInvalidArgument,
        "Expected 'latitude_deg', 'longitude_deg', 'height_m' and 'q_enu_map' [x, y, z, w].");
  }
  const double pose[] = {0, 0, 0, (*rotation)[0], (*rotation)[1], (*rotation)[2], (*rotation)[3]};
  georeference.latitude_deg = *latitude;
  georeference.longitude_deg = *longitude;
  georeference.height_m = *height;
  georeference.R_enu_map = pose_from_xyz_qxyzw(pose).linear();
  return georeference;
}

Response get_georeference(Services& services, const Call& call) {
  const MapInfo map = services.store.map(call.path("map"));
  if (!map.georeference) {
    throw Error(ErrorCode::kNotFound, "It is not known where this map lies on Earth.");
  }
  return json_response(to_json(*map.georeference));
}

Response put_georeference(Services& services, const Call& call) {
  const Georeference georeference = read_georeference(call.json());
  services.store.set_georeference(call.path("map"), georeference);
  return json_response(to_json(georeference));
}

Response remove_georeference(Services& services, const Call& call) {
  services.store.set_georeference(call.path("map"), {});
  Response response;
  response.status = 204;
  return response;
}

}  // namespace

void add_georeference_routes(Router& router, Services& services) {
  const std::vector<std::string_view> json{"application/json"};
  const std::string path = "/v1/maps/{map}/georeference";
  router.add({"GET", path, {}, 0, json, [&](const Call& call) {
                return get_georeference(services, call);
              }});
  router.add({"PUT", path, {}, kMaxGeoreferenceBody, json, [&](const Call& call) {
                return put_georeference(services, call);
              }});
  router.add({"DELETE", path, {}, 0, {}, [&](const Call& call) {
                return remove_georeference(services, call);
              }});
}

}  // namespace cellmap::server
