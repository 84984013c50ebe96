#include "server/api/shared_searcher.hpp"

#include <algorithm>
#include <future>
#include <unordered_set>
#include <utility>

namespace cellmap::server {
namespace {

void append(RegionList& to, const RegionList& regions) {
  to.insert(to.end(), regions.begin(), regions.end());
}

std::size_t cells_in(const RegionList& regions) {
  std::size_t cells = 0;
  for (const PlaceRegions::Region* region : regions) cells += region->ids.size();
  return cells;
}

/// The regions that the answer is of; what is left are those that the other knows otherwise.
RegionList answered_of(const PlaceAnswer& answer, RegionList& regions) {
  RegionList answered, rest;
  auto unknown = answer.unknown.begin();
  for (std::uint32_t i = 0; i < regions.size(); ++i) {
    const bool is_unknown = unknown != answer.unknown.end() && *unknown == i;
    if (is_unknown) ++unknown;
    (is_unknown ? rest : answered).push_back(regions[i]);
  }
  regions = std::move(rest);
  return answered;
}

/// Whether as many CELLs were kept as there have to be, all of these regions.
bool fits(const ComparedPlaces& places, const RegionList& regions, const SearchTerms& terms) {
  std::unordered_set<CellId> kept;
  for (const ComparedPlace& place : places) kept.insert(place.id);
  std::size_t found = 0;
  for (const PlaceRegions::Region* region : regions) {
    for (const CellId id : region->ids) found += kept.contains(id);
  }
  return found == places.size() && found == std::min(cells_in(regions), terms.kept());
}

}  // namespace

/// The part of one server, which is on its way.
struct SharedSearcher::Share {
  PlaceServer& server;
  RegionList regions;  ///< by key; when the answer was read, those that it does not cover
  std::future<std::optional<PlaceAnswer>> answer;

  ComparedPlaces take(const SearchTerms& terms) {
    auto found = answer.get();
    if (!found) return {};
    RegionList left = regions;
    const RegionList answered = answered_of(*found, left);
    if (!fits(found->places, answered, terms)) {
      server.failed("it answered of other CELLs than it was asked for");
      return {};
    }
    regions = std::move(left);
    return std::move(found->places);
  }
};

SharedSearcher::SharedSearcher(PlaceServers& servers, Metrics& metrics, std::string map,
                               Revision revision, std::shared_ptr<const PlaceSearcher> own,
                               OnBehalfOf caller)
    : servers_(servers),
      metrics_(metrics),
      map_(std::move(map)),
      revision_(revision),
      own_(std::move(own)),
      caller_(std::move(caller)) {}

std::vector<RegionList> SharedSearcher::by_owner(const RegionList& regions) const {
  const RegionOwners owners = servers_.owners(map_);
  std::vector<RegionList> shares(servers_.others() + 1);
  for (const auto* region : regions) shares[owners.owner_of(region->key)].push_back(region);
  return shares;
}

PlaceQuery SharedSearcher::query_for(const QueryViews& query, const RegionList& regions,
                                     const SearchTerms& terms) const {
  PlaceQuery asked{query, terms, revision_, {}};
  asked.regions.reserve(regions.size());
  for (const auto* region : regions) {
    asked.regions.push_back({region->key, checksum_of_cells(*region)});
  }
  return asked;
}

SharedSearcher::Share SharedSearcher::asked(std::size_t server, const QueryViews& query,
                                            RegionList regions, const SearchTerms& terms) const {
  PlaceServer& other = servers_.server(server);
  const auto deadline = std::chrono::steady_clock::now() + servers_.options().timeout;
  auto answer = std::async(std::launch::async,
                           [&other, this, asked = query_for(query, regions, terms), deadline] {
                             return other.ask(map_, asked, caller_, deadline);
                           });
  return {other, std::move(regions), std::move(answer)};
}

ComparedPlaces SharedSearcher::search(const QueryViews& query, const RegionList& regions,
                                      const SearchTerms& terms, const Effort& effort) const {
  if (!servers_.share(cells_in(regions))) return own_->search(query, regions, terms, effort);
  std::vector<RegionList> shares = by_owner(regions);
  RegionList own = std::move(shares[servers_.self()]), instead;
  std::vector<Share> others;
  for (std::size_t i = 0; i < shares.size(); ++i) {
    if (i == servers_.self() || shares[i].empty()) continue;
    if (servers_.server(i).is_left_alone()) {
      metrics_.place_server_asked(servers_.options().servers[i], "left_alone");
      append(instead, shares[i]);
    } else {
      others.push_back(asked(i, query, std::move(shares[i]), terms));
    }
  }
  std::vector<ComparedPlaces> found;
  found.push_back(own_->search(query, own, terms, effort));
  for (Share& share : others) {
    found.push_back(share.take(terms));
    append(instead, share.regions);
  }
  if (!instead.empty()) found.push_back(own_->search(query, instead, terms, effort));
  metrics_.place_regions_taken_over(instead.size());
  return merged(std::move(found), terms);
}

}  // namespace cellmap::server
