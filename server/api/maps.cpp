#include "cellmap/core/error.hpp"
#include "server/api/access.hpp"
#include "server/api/api.hpp"

// /v1/maps and /v1/maps/{map}.

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxMapBody = 64u << 10;

Response list_maps(Services& services, const Call& call) {
  Json maps = Json::array();
  for (const auto& map : services.store.maps()) {
    if (call.may_use(map.name)) maps.push_back(to_json(map));
  }
  return json_response({{"maps", std::move(maps)}});
}

Response create_map(Services& services, const Call& call) {
  const Json json = call.json();
  ObjectReader reader(json, "the map");
  const auto name = reader.text("name");
  if (!name) throw Error(ErrorCode::kInvalidArgument, "Expected a 'name' for the map.");
  const Json* lattice = reader.object("lattice");
  const LatticeSpec spec = lattice ? lattice_from_json(*lattice) : LatticeSpec{};
  const CellForm form = read_form(reader).value_or(CellForm{});
  reader.finish();
  validate_map_name(*name);
  if (!call.may_use(*name)) return map_refused(*name);
  Response response = json_response(to_json(services.store.create_map(*name, spec, form)), 201);
  response.headers.set("Location", "/v1/maps/" + *name);
  return response;
}

Response remove_map(Services& services, const Call& call) {
  const auto& name = call.path("map");
  const auto state = services.maps.open(name);
  {
    const std::lock_guard lock(state->writer());
    if (services.jobs.has_unfinished(name)) {
      throw Error(ErrorCode::kConflict, "The map has unfinished jobs; cancel them first.");
    }
    services.store.delete_map(name);
  }
  services.maps.forget(name);
  Response response;
  response.status = 204;
  return response;
}

}  // namespace

void add_map_routes(Router& router, Services& services) {
  const std::vector<std::string_view> json{"application/json"};
  router.add({"GET", "/v1/maps", {}, 0, json, [&](const Call& call) {
                return list_maps(services, call);
              }});
  router.add({"POST", "/v1/maps", {}, kMaxMapBody, json, [&](const Call& call) {
                return create_map(services, call);
              }});
  router.add({"GET", "/v1/maps/{map}", {}, 0, json, [&](const Call& call) {
                return json_response(to_json(services.store.map(call.path("map"))));
              }});
  router.add({"DELETE", "/v1/maps/{map}", {}, 0, {}, [&](const Call& call) {
                return remove_map(services, call);
              }});
}

}  // namespace cellmap::server
