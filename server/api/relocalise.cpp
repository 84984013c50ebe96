#include "cellmap/place/relocalise.hpp"

#include <chrono>
#include <numbers>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/scan_batch.hpp"
#include "cellmap/codec/scan_codec.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "server/api/api.hpp"
#include "server/api/media_types.hpp"
#include "server/api/shared_searcher.hpp"
#include "server/api/text.hpp"
#include "server/api/turn.hpp"

// POST /v1/maps/{map}/relocalise.

namespace cellmap::server {
namespace {

constexpr std::size_t kMaxQueryBody = 33u << 20;

RelocalisationQuery read_cell(const std::string& body, const Lattice& lattice) {
  const Cell cell = decode_cell(as_bytes(body));
  if (cell.lattice != lattice.spec()) {
    throw Error(ErrorCode::kInvalidArgument, "The CELL's lattice is " + to_string(cell.lattice) +
                                                 ", the map's " + to_string(lattice.spec()) + ".");
  }
  return RelocalisationQuery::from_cell(cell, lattice);
}

/// Drops points as the front end does.
void clean(PointCloud& points) {
  Scan scan = filter_scan(std::move(points), 0, {});
  if (scan.points.empty()) {
    throw Error(ErrorCode::kInvalidArgument,
                "A scan has no usable point: " + std::to_string(scan.dropped_non_finite) +
                    " are not finite, " + std::to_string(scan.dropped_range) +
                    " nearer than 2 m or farther than 120 m.");
  }
  points = std::move(scan.points);
}

RelocalisationQuery read_scans(const std::string& body) {
  std::vector<PosedScan> scans = decode_scan_batch(as_bytes(body));
  for (PosedScan& scan : scans) clean(scan.points);
  return RelocalisationQuery::from_scans(scans);
}

RelocalisationQuery read_query(const Call& call, const Lattice& lattice) {
  const auto type =
      call.content_type({"application/octet-stream", kScanType, kScansType, kCellType});
  const std::string body = call.content(kMaxQueryBody);
  if (type == kCellType) return read_cell(body, lattice);
  if (type == kScansType) return read_scans(body);
  PointCloud points =
      type == kScanType ? decode_scan(as_bytes(body)).points : parse_kitti_bin(as_bytes(body));
  clean(points);
  return RelocalisationQuery::from_scan(std::move(points));
}

std::optional<PosePrior> read_prior(const Call& call) {
  const auto numbers = call.query_numbers("prior", 7);
  const auto radius = call.query_number("radius", 0, 10'000);
  const auto yaw_range_deg = call.query_number("yaw_range_deg", 0, 180);
  const auto covariance = call.query_numbers("prior_covariance", 21);
  if (!numbers) {
    if (!radius && !yaw_range_deg && !covariance) return std::nullopt;
    throw Error(ErrorCode::kInvalidArgument,
                "'radius', 'yaw_range_deg' and 'prior_covariance' need a 'prior'.");
  }
  PosePrior prior;
  prior.T_map_scan = pose_from_xyz_qxyzw(std::span<const double, 7>(numbers->data(), 7));
  if (covariance) {
    if (!radius && !yaw_range_deg) {
      return prior_from_covariance(prior.T_map_scan, symmetric_from_upper(*covariance));
    }
    throw Error(ErrorCode::kInvalidArgument,
                "Expected either 'prior_covariance' or 'radius' and 'yaw_range_deg'.");
  }
  prior.radius_m = radius.value_or(prior.radius_m);
  if (prior.radius_m <= 0) {
    throw Error(ErrorCode::kInvalidArgument, "Expected 'radius' to be above 0.");
  }
  if (yaw_range_deg) prior.yaw_range_rad = *yaw_range_deg * std::numbers::pi / 180;
  return prior;
}

Json cell_name(const Services& services, const std::string& map, CellId id) {
  return {{"id", id.value}, {"hash", to_hex(services.store.cell(map, id).hash)}};
}

Json to_document(const Services& services, const std::string& map,
                 const RelocalisationAnswer& answer) {
  Json json{{"found", answer.found.has_value()}};
  if (const auto& found = answer.found) {
    json["T_map_scan"] = to_json(found->T_map_scan);
    json["covariance"] = to_json(answer.covariance);
    json["cell"] = cell_name(services, map, found->cell);
    json["T_cell_scan"] = to_json(found->T_cell_scan);
    if (const auto georeference = services.store.map(map).georeference) {
      json["geopose"] = to_json(to_geopose(*georeference, found->T_map_scan));
    }
    document::add_evidence(json, *found);
    json["degenerate"] = found->registration.degeneracy.degenerate;
  }
  json["alternatives"] = Json::array();
  for (const auto& other : answer.alternatives) {
    Json alternative{{"cell", cell_name(services, map, other.cell)},
                     {"T_map_scan", to_json(other.T_map_scan)},
                     {"accepted", other.accepted}};
    document::add_evidence(alternative, other);
    json["alternatives"].push_back(std::move(alternative));
  }
  json["cells_considered"] = answer.cells_considered;
  return json;
}

/// What is large is searched together with the other servers.
PlaceIndex index_of(Services& services, const Call& call, const MapState& state,
                    const MapState::Places& places) {
  std::shared_ptr<const PlaceSearcher> searcher = places.searcher;
  if (services.place_servers.others() > 0) {
    searcher = std::make_shared<const SharedSearcher>(
        services.place_servers, services.metrics, state.name(), places.graph->revision,
        places.searcher,
        OnBehalfOf{call.request_id(), std::optional<std::string>(call.header("Authorization")),
                   call.address()});
  }
  return {places.regions, std::move(searcher)};
}

Response relocalise(Services& services, const Call& call) {
  const auto state = services.maps.open(call.path("map"));
  const auto prior = read_prior(call);
  RelocalisationQuery query = read_query(call, *state->lattice());
  query.prior = prior;
  std::shared_ptr<const PoseGraph> graph;
  RelocalisationAnswer answer;
  std::chrono::duration<double, std::milli> elapsed{};
  in_turn(services, [&](const Effort& effort) {
    const auto start = std::chrono::steady_clock::now();
    const MapState::Places places = state->places();
    graph = places.graph;
    RelocaliseOptions options;
    options.threads = options.registration.threads = effort.threads;
    options.registration.give_way = effort.give_way;
    answer = index_of(services, call, *state, places)
                 .relocalise(query, *graph, MapState::targets(state), options);
    elapsed = std::chrono::steady_clock::now() - start;
  });
  services.metrics.relocalisation(answer.found.has_value());
  Json json = to_document(services, state->name(), answer);
  json["revision"] = graph->revision;
  json["time_ms"] = elapsed.count();
  return json_response(json);
}

}  // namespace

void add_relocalise_route(Router& router, Services& services) {
  router.add({"POST",
              "/v1/maps/{map}/relocalise",
              {"prior", "radius", "yaw_range_deg", "prior_covariance"},
              kMaxQueryBody,
              {"application/json"},
              [&](const Call& call) { return relocalise(services, call); }});
}

}  // namespace cellmap::server
