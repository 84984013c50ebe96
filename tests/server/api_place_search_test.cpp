#include "cellmap/codec/place_search_codec.hpp"
#include "cellmap/store/read_cell.hpp"
#include "server/api/place_servers.hpp"
#include "server/guarded_fixture.hpp"

// POST /v1/maps/{map}/places:search, as another server asks it.

namespace cellmap::server::test {
namespace {

constexpr const char* kSearch = "/v1/maps/town/places:search";

/// What another server that knows this graph asks for.
PlaceQuery query_of(const PoseGraph& graph, const SearchTerms& terms) {
  const PointCloud scan = street_scan(3).points;
  PlaceQuery query{DescribedQuery(scan).views(), terms, graph.revision, {}};
  const PlaceRegions regions(graph);
  for (const auto& region : regions.all()) {
    query.regions.push_back({region.key, checksum_of_cells(region)});
  }
  return query;
}

class ApiPlaceSearch : public ApiTest {
 protected:
  ApiPlaceSearch() {
    make_map();
    put_street(3);
    move(3, 1000);
  }
  void move(std::uint32_t cell, double x) {
    MapUpdate update;
    update.poses[{cell}] = level_pose(x, 0, 0);
    store_->commit("town", update);
  }
  Response ask(const Bytes& body, const std::string& type = kPlaceQueryType) {
    return send("POST", kSearch, to_text(body), {{"Content-Type", type}});
  }
  PlaceAnswer asked(const PlaceQuery& query) {
    const Response response = ask(encode_place_query(query));
    EXPECT_EQ(response.status, 200) << body_view(response);
    EXPECT_EQ(response.headers.get("Content-Type"), kPlaceAnswerType);
    return decode_place_answer(as_bytes(body_view(response)), query.terms, query.regions.size());
  }
};

TEST_F(ApiPlaceSearch, ItFindsWhatASearchInOneProcessFinds) {
  const PlaceQuery query = query_of(store_->pose_graph("town"), {2, false});
  ASSERT_EQ(query.regions.size(), 2u);
  const PlaceAnswer answer = asked(query);
  EXPECT_TRUE(answer.unknown.empty());
  ASSERT_EQ(answer.places.size(), 2u);
  for (const ComparedPlace& place : answer.places) {
    const auto expected =
        describe_place(reconstruct_points(read_cell(*store_, "town", place.id), Lattice(kLattice)));
    EXPECT_EQ(to_bytes(*place.place), to_bytes(expected));
    EXPECT_EQ(place.likeness, likeness(query.views, expected));
  }
}

/// Whoever of the two saw the commit first, nobody searches what the other did not mean.
TEST_F(ApiPlaceSearch, RegionsThatItKnowsOtherwiseAreNamedAndNotSearched) {
  const PlaceQuery before = query_of(store_->pose_graph("town"), {10, false});
  move(2, 1010);
  const PlaceAnswer both = asked(before);
  EXPECT_EQ(both.unknown, (std::vector<std::uint32_t>{0, 1}));
  EXPECT_TRUE(both.places.empty());
  PlaceQuery now = query_of(store_->pose_graph("town"), {10, false});
  ++now.regions[0].cells;
  now.regions.push_back({{77, 7}, 1});
  const PlaceAnswer one = asked(now);
  EXPECT_EQ(one.unknown, (std::vector<std::uint32_t>{0, 2}));
  ASSERT_EQ(one.places.size(), 2u);  // CELLs 2 and 3
  EXPECT_TRUE(std::ranges::none_of(one.places, [](const auto& p) { return p.id.value == 1; }));
}

TEST_F(ApiPlaceSearch, WhatIsNoSearchIsRefused) {
  const Bytes good = encode_place_query(query_of(store_->pose_graph("town"), {2, false}));
  expect_problem(ask(good, "text/plain"), 415, "unsupported");
  expect_problem(ask({}), 422, "corrupt-data");
  expect_problem(ask(Bytes(good.begin(), good.begin() + 2000)), 422, "corrupt-data");
  expect_problem(ask(Bytes(kMaxPlaceQueryBytes + 1)), 413, "too-large");
  expect_problem(send("POST", "/v1/maps/none/places:search", to_text(good),
                      {{"Content-Type", kPlaceQueryType}}),
                 404, "not-found");
}

/// Relocalisations wait for searches of other servers, never the other way round.
TEST_F(ApiPlaceSearch, ItHasATurnOfItsOwn) {
  const PlaceQuery query = query_of(store_->pose_graph("town"), {2, false});
  ApiOptions no_relocalisations = options();
  no_relocalisations.relocalisations = 0;
  start(no_relocalisations);
  EXPECT_EQ(asked(query).places.size(), 2u);
  ApiOptions none = options();
  none.place_searches = 0;
  none.place_servers.timeout = std::chrono::milliseconds(1);
  start(none);
  expect_problem(ask(encode_place_query(query)), 503, "unavailable");
}

class ApiPlaceSearchAccess : public GuardedApiTest {};

TEST_F(ApiPlaceSearchAccess, TheCallersTokenLetsItIn) {
  const auto ask = [&](const std::vector<Headed>& headers) {
    PlaceQuery query = query_of({}, {2, false});
    auto all = headers;
    all.push_back({"Content-Type", kPlaceQueryType});
    return send("POST", kSearch, to_text(encode_place_query(query)), all);
  };
  EXPECT_EQ(ask({}).status, 401);
  EXPECT_EQ(ask({bearer(add_token("reader", {Scope::kMapRead}))}).status, 403);
  EXPECT_EQ(ask({bearer(add_token("elsewhere", {Scope::kRelocalise}, {"harbour"}))}).status, 403);
  EXPECT_EQ(ask({bearer(add_token("robot", {Scope::kRelocalise}, {"town"}))}).status, 200);
}

}  // namespace
}  // namespace cellmap::server::test
