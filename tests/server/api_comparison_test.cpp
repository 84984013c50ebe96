#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kComparison = "/v1/maps/town/comparison";

Json row_of(const std::string& name) {
  Json row{
      {"name", name}, {"measured", true}, {"f_score", {{"0.05", 0.5}, {"0.1", 0.6}, {"0.2", 1}}}};
  for (const char* key :
       {"bytes", "bytes_per_m", "planes", "bytes_per_plane", "accuracy_m", "completeness_m",
        "registration_error_m", "registration_origin_m", "registration_turn_deg", "registrations",
        "registrations_failed", "encode_s", "decode_s"}) {
    row[key] = 2;
  }
  return row;
}

Json comparison(const Json& rows) {
  return {
      {"dataset", "kitti"}, {"scans", 40}, {"held_back", 8}, {"length_m", 72.5}, {"rows", rows}};
}

class ApiComparison : public ApiTest {
 protected:
  ApiComparison() { post("/v1/maps", R"({"name":"town"})"); }
  Response put(const Json& json, const std::string& target = kComparison) {
    return send("PUT", target, json.dump(), {{"Content-Type", "application/json"}});
  }
};

TEST_F(ApiComparison, IsKeptWithTheMapAndReplacedByTheNext) {
  expect_problem(get(kComparison), 404, "not-found");
  const Json first = comparison(Json::array({row_of("CELLs")})), second = comparison(Json::array());
  ASSERT_EQ(put(first).status, 200);
  EXPECT_EQ(json_of(get(kComparison)), first);
  start();  // the server starts again
  EXPECT_EQ(json_of(get(kComparison)), first);
  EXPECT_EQ(json_of(put(second)), second);
  EXPECT_EQ(json_of(get(kComparison)), second);
}

TEST_F(ApiComparison, GoesWithItsMap) {
  ASSERT_EQ(put(comparison(Json::array())).status, 200);
  ASSERT_EQ(send("DELETE", "/v1/maps/town").status, 204);
  expect_problem(get(kComparison), 404, "not-found");
  post("/v1/maps", R"({"name":"town"})");
  expect_problem(get(kComparison), 404, "not-found");
}

TEST_F(ApiComparison, MayLeaveEmptyWhatWasNotMeasured) {
  Json row = row_of("published");
  row["measured"] = false;
  row["note"] = "somebody's";
  for (const char* key : {"bytes", "accuracy_m", "encode_s"}) row[key] = nullptr;
  row["f_score"]["0.1"] = nullptr;
  EXPECT_EQ(put(comparison(Json::array({row}))).status, 200);
}

TEST_F(ApiComparison, ThatIsNoneIsRefused) {
  const auto changed = [&](const std::function<void(Json&)>& change) {
    Json row = row_of("CELLs");
    change(row);
    return put(comparison(Json::array({row})));
  };
  expect_problem(put(Json::object()), 400, "invalid-argument");
  expect_problem(put(comparison(Json::object())), 400, "invalid-argument");
  expect_problem(put(comparison(Json::array({1}))), 400, "invalid-argument");
  expect_problem(changed([](Json& row) { row.erase("bytes"); }), 400, "invalid-argument");
  expect_problem(changed([](Json& row) { row["bytes"] = "many"; }), 400, "invalid-argument");
  expect_problem(changed([](Json& row) { row["encode_s"] = -1; }), 400, "invalid-argument");
  expect_problem(changed([](Json& row) { row["name"] = std::string(600, 'n'); }), 400,
                 "invalid-argument");
  expect_problem(changed([](Json& row) { row["other"] = 1; }), 400, "invalid-argument");
  expect_problem(changed([](Json& row) { row["f_score"]["0.3"] = 1; }), 400, "invalid-argument");
  expect_problem(changed([](Json& row) { row["f_score"] = nullptr; }), 400, "invalid-argument");
  expect_problem(put(comparison(Json(std::vector<Json>(501, row_of("CELLs"))))), 400,
                 "invalid-argument");
  expect_problem(get(kComparison), 404, "not-found");
}

TEST_F(ApiComparison, NeedsAMapAndJson) {
  expect_problem(put(comparison(Json::array()), "/v1/maps/none/comparison"), 404, "not-found");
  expect_problem(get("/v1/maps/none/comparison"), 404, "not-found");
  expect_problem(send("PUT", kComparison, "{}", {{"Content-Type", "text/plain"}}), 415,
                 "unsupported");
}

}  // namespace
}  // namespace cellmap::server::test
