#include "cellmap/place/place_search.hpp"

#include "server/api/api.hpp"
#include "server/api/place_servers.hpp"
#include "server/api/turn.hpp"

// POST /v1/maps/{map}/places:search: what one server asks another while it relocalises.

namespace cellmap::server {
namespace {

/// Those that are known here with the same CELLs; the others are named in the answer.
RegionList known_regions(const PlaceQuery& query, const PlaceRegions& regions,
                         PlaceAnswer& answer) {
  RegionList known;
  for (std::uint32_t i = 0; i < query.regions.size(); ++i) {
    const AskedRegion& asked = query.regions[i];
    const PlaceRegions::Region* region = regions.find(asked.key);
    if (region && checksum_of_cells(*region) == asked.cells) {
      known.push_back(region);
    } else {
      answer.unknown.push_back(i);
    }
  }
  return known;
}

/// Servers that do not agree on who has which region answer rightly, but hold regions twice.
void check_ownership(Services& services, const std::string& map, const PlaceQuery& query) {
  const PlaceServers& servers = services.place_servers;
  if (query.regions.empty()) return;
  const auto is_own = [&, owners = servers.others() > 0 ? std::optional(servers.owners(map))
                                                        : std::nullopt](const AskedRegion& asked) {
    return owners && owners->owner_of(asked.key) == servers.self();
  };
  if (std::ranges::all_of(query.regions, is_own) || !services.says_strange_regions()) return;
  services.log->warn(
      "was asked to search regions of {} that are not its own: the servers have different "
      "--place-servers, or one says --place-self of another",
      map);
}

Response search_places(Services& services, const Call& call) {
  const auto state = services.maps.open(call.path("map"));
  call.content_type({kPlaceQueryType});
  const PlaceQuery query = decode_place_query(as_bytes(call.content(kMaxPlaceQueryBytes)));
  check_ownership(services, state->name(), query);
  PlaceAnswer answer;
  in_turn(services.place_turns, services.options.threads, [&](const Effort& effort) {
    const MapState::Places places = state->places();
    const RegionList known = known_regions(query, *places.regions, answer);
    answer.places = places.searcher->search(query.views, known, query.terms, effort);
  });
  const auto bytes = std::make_shared<const Bytes>(encode_place_answer(answer, query.terms));
  Response response;
  response.headers.set("Content-Type", kPlaceAnswerType);
  response.headers.set("Cache-Control", "no-store");
  response.body = SharedBytes{bytes, 0, bytes->size()};
  return response;
}

}  // namespace

void add_place_search_route(Router& router, Services& services) {
  Route route{"POST",
              "/v1/maps/{map}/places:search",
              {},
              kMaxPlaceQueryBytes,
              {kPlaceAnswerType},
              [&](const Call& call) { return search_places(services, call); }};
  route.for_servers = true;
  router.add(std::move(route));
}

}  // namespace cellmap::server
