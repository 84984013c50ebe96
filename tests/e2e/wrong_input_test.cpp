#include <gmock/gmock.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "codec/samples.hpp"
#include "e2e/cellmapd_process.hpp"
#include "support/http_library.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::test {
namespace {

using testing::HasSubstr;

/// A request that must be refused.
struct Wrong {
  std::string method, path, content_type, body;
  int status;
  std::string code, says;  ///< of the problem document
};

/// One server with one empty map and one with a CELL.
class WrongInput : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    work_ = std::make_unique<TempFolder>();
    server_ = std::make_unique<CellmapdProcess>(*work_ / "map.db", work_->path());
    Client client = server_->client();
    client.create_map("m", {LatticeKind::kFibonacci, 1000});
    client.put_cell("m", CellId{1}, encode_cell(random_cell(1, 50, 1000)));
  }
  static void TearDownTestSuite() {
    server_.reset();
    work_.reset();
  }

  static httplib::Response send(const Wrong& wrong) {
    httplib::Client http("127.0.0.1", server_->port());
    httplib::Request request;
    request.method = wrong.method;
    request.path = wrong.path;
    request.body = wrong.body;
    if (!wrong.content_type.empty()) request.set_header("Content-Type", wrong.content_type);
    const auto result = http.send(request);
    if (!result) {
      ADD_FAILURE() << wrong.method << ' ' << wrong.path << ": "
                    << httplib::to_string(result.error());
      return {};
    }
    return *result;
  }

  static void expect_refused(const Wrong& wrong) {
    const httplib::Response response = send(wrong);
    const std::string what = wrong.method + " " + wrong.path + "\n" + response.body;
    EXPECT_EQ(response.status, wrong.status) << what;
    EXPECT_THAT(response.get_header_value("Content-Type"), HasSubstr("application/problem+json"))
        << what;
    const auto problem = nlohmann::json::parse(response.body, nullptr, false);
    ASSERT_TRUE(problem.is_object()) << what;
    EXPECT_EQ(problem.value("code", ""), wrong.code) << what;
    EXPECT_THAT(problem.value("detail", ""), HasSubstr(wrong.says)) << what;
  }

  static inline std::unique_ptr<TempFolder> work_;
  static inline std::unique_ptr<CellmapdProcess> server_;
};

TEST_F(WrongInput, OfMapsAndCells) {
  const std::string json = "application/json", cell = "application/vnd.cellmap.cell";
  for (const Wrong& wrong : {
           Wrong{"GET", "/v1/maps/nowhere", "", "", 404, "not-found", "nowhere"},
           Wrong{"GET", "/v1/nothing", "", "", 404, "not-found", ""},
           Wrong{"DELETE", "/v1/maps", "", "", 405, "method-not-allowed", ""},
           Wrong{"POST", "/v1/maps", json, "{", 400, "invalid-argument", ""},
           Wrong{"POST", "/v1/maps", json, R"({"name":"UPPER"})", 400, "invalid-argument", "a-z"},
           Wrong{"POST", "/v1/maps", json, R"({"name":"m"})", 409, "already-exists", "m"},
           Wrong{"POST", "/v1/maps", "text/plain", R"({"name":"x"})", 415, "unsupported", ""},
           Wrong{"GET", "/v1/maps/m/cells?bbox=1,2,3", "", "", 400, "invalid-argument", "bbox"},
           Wrong{"GET", "/v1/maps/m/cells?near=0,0,nan&radius=3", "", "", 400, "invalid-argument",
                 "near"},
           Wrong{"GET", "/v1/maps/m/cells?limit=0", "", "", 400, "invalid-argument", "limit"},
           Wrong{"GET", "/v1/maps/m/cells/2", "", "", 404, "not-found", "2"},
           Wrong{"GET", "/v1/maps/m/cells/minus", "", "", 400, "invalid-argument", ""},
           Wrong{"PUT", "/v1/maps/m/cells/7", cell, "no CELL at all", 422, "corrupt-data", ""},
           Wrong{"PUT", "/v1/maps/m/cells/7", "text/plain", "x", 415, "unsupported", ""},
           Wrong{"POST", "/v1/maps/m/cells:batch", json, "{}", 400, "invalid-argument", ""},
           Wrong{"POST", "/v1/maps/m/cells:batch", json, R"({"ids":[99]})", 404, "not-found", "99"},
           Wrong{"GET", "/v1/maps/m/pose-graph?revision=999", "", "", 404, "not-found", "999"},
           Wrong{"GET", "/v1/maps/m/changes?since=x", "", "", 400, "invalid-argument", "since"},
           Wrong{"GET", "/v1/maps/m/trajectory?session=none", "", "", 404, "not-found", "none"},
       }) {
    expect_refused(wrong);
  }
}

TEST_F(WrongInput, OfScansLoopsAndJobs) {
  const std::string json = "application/json", bin = "application/octet-stream";
  for (const Wrong& wrong : {
           Wrong{"POST", "/v1/maps/m/relocalise", bin, "17 bytes, not 16!", 422, "corrupt-data",
                 "16"},
           Wrong{"POST", "/v1/maps/m/relocalise", "application/vnd.cellmap.scan", "junk", 422,
                 "corrupt-data", ""},
           Wrong{"POST", "/v1/maps/m/relocalise", "image/png", "junk", 415, "unsupported", ""},
           Wrong{"POST", "/v1/maps/m/relocalise?prior=1,2,nan,0,0,0,1", bin, std::string(160, '\0'),
                 400, "invalid-argument", "prior"},
           Wrong{"POST", "/v1/maps/m/loops", json, R"({"from":1,"to":1,"pose":[0,0,0,0,0,0,1]})",
                 400, "invalid-argument", ""},
           Wrong{"POST", "/v1/maps/m/loops", json, R"({"from":1,"to":9,"pose":[0,0,0,0,0,0,1]})",
                 404, "not-found", "9"},
           Wrong{"POST", "/v1/maps/m/loops", json, R"({"from":1,"to":2,"pose":[0,0,0,0,0,0,0]})",
                 400, "invalid-argument", "pose"},
           Wrong{"DELETE", "/v1/maps/m/loops/77", "", "", 404, "not-found", "77"},
           Wrong{"POST", "/v1/maps/m/jobs", json, R"({"kind":"ingest"})", 400, "invalid-argument",
                 ""},
           Wrong{"POST", "/v1/maps/m/jobs", json, R"({"kind":"ingest","path":"/etc"})", 400,
                 "invalid-argument", ""},
           Wrong{"GET", "/v1/jobs/123", "", "", 404, "not-found", "123"},
           Wrong{"DELETE", "/v1/jobs/123", "", "", 404, "not-found", "123"},
           Wrong{"PUT", "/v1/jobs/123/scans/0", "application/vnd.cellmap.scan", "x", 404,
                 "not-found", "123"},
           Wrong{"POST", "/v1/jobs/123/complete", "", "", 404, "not-found", "123"},
           Wrong{"GET", "/v1/jobs/123/events", "", "", 404, "not-found", "123"},
           Wrong{"POST", "/v1/maps/m/sessions/s/scans", "application/vnd.cellmap.scans", "x", 422,
                 "corrupt-data", "length"},
           Wrong{"POST", "/v1/maps/m/sessions/s/scans", bin, "x", 415, "unsupported", "scans"},
           Wrong{"POST", "/v1/maps/m/sessions/s/scans:complete", "", "", 404, "not-found", "s"},
       }) {
    expect_refused(wrong);
  }
}

TEST_F(WrongInput, ThroughTheClientHasTheSameCodeAndLosesNothing) {
  Client client = server_->client();
  const auto code = [](const auto& act) {
    try {
      act();
    } catch (const Error& error) {
      return std::string(to_string(error.code()));
    }
    return std::string("nothing was thrown");
  };
  EXPECT_EQ(code([&] { client.map("nowhere"); }), "not-found");
  EXPECT_EQ(code([&] { client.create_map("m"); }), "already-exists");
  EXPECT_EQ(code([&] { client.cell("m", CellId{2}); }), "not-found");
  EXPECT_EQ(code([&] { client.put_cell("m", CellId{1}, encode_cell(random_cell(2, 50, 1000))); }),
            "conflict");
  EXPECT_EQ(code([&] { client.put_cell("m", CellId{3}, encode_cell(random_cell(3, 50, 2000))); }),
            "invalid-argument");
  EXPECT_EQ(code([&] { client.job(JobId{99}); }), "not-found");
  EXPECT_FALSE(client.put_cell("m", CellId{1}, encode_cell(random_cell(1, 50, 1000))).created);
  EXPECT_EQ(client.map("m").cells, 1u);
  EXPECT_EQ(client.cell("m", CellId{1}).encoded.hash, encode_cell(random_cell(1, 50, 1000)).hash);
}

}  // namespace
}  // namespace cellmap::test
