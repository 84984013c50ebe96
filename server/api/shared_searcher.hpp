#pragma once

#include <memory>
#include <string>

#include "cellmap/place/place_search.hpp"
#include "server/api/place_servers.hpp"

namespace cellmap::server {

/// Searches of one request that are shared out among the servers: each is asked for its own
/// regions, while this one searches its own, and for what another cannot do too. The places found
/// are those of one search of all regions, whoever did what.
class SharedSearcher : public PlaceSearcher {
 public:
  /// `servers` outlive it. `own`: searches in this process.
  SharedSearcher(PlaceServers& servers, Metrics& metrics, std::string map, Revision revision,
                 std::shared_ptr<const PlaceSearcher> own, OnBehalfOf caller);

  ComparedPlaces search(const QueryViews& query, const RegionList& regions,
                        const SearchTerms& terms, const Effort& effort) const override;

 private:
  struct Share;
  std::vector<RegionList> by_owner(const RegionList& regions) const;
  PlaceQuery query_for(const QueryViews& query, const RegionList& regions,
                       const SearchTerms& terms) const;
  Share asked(std::size_t server, const QueryViews& query, RegionList regions,
              const SearchTerms& terms) const;

  PlaceServers& servers_;
  Metrics& metrics_;
  const std::string map_;
  const Revision revision_;
  const std::shared_ptr<const PlaceSearcher> own_;
  const OnBehalfOf caller_;
};

}  // namespace cellmap::server
