#include "cellmap/codec/cell_batch.hpp"
#include "cellmap/codec/zstd.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kCells = "/v1/maps/town/cells";

class ApiCells : public ApiTest {
 protected:
  ApiCells() { make_map(); }
};

TEST_F(ApiCells, APutCellComesBackByteForByte) {
  const EncodedCell cell = street_cell(0, 0);
  const auto made = put_cell(1, cell, {{"CELLmap-Pose", "1 2 3 0 0 0 1"}});
  ASSERT_EQ(made.status, 201) << body_view(made);
  EXPECT_EQ(made.headers.get("Location"), kCell1);
  EXPECT_EQ(json_of(made)["hash"], to_hex(cell.hash));
  const auto answer = get(kCell1);
  EXPECT_EQ(answer.status, 200);
  EXPECT_EQ(body_view(answer), to_text(cell.bytes));
  EXPECT_EQ(answer.headers.get("ETag"), '"' + to_hex(cell.hash) + '"');
  EXPECT_EQ(answer.headers.get("CELLmap-Pose"), "1 2 3 0 0 0 1");
  EXPECT_EQ(answer.headers.get("CELLmap-Revision"), "1");
  EXPECT_EQ(answer.headers.get("Cache-Control"), "public, no-cache");
}

TEST_F(ApiCells, WithoutAPoseACellStaysWhereItWasBorn) {
  ASSERT_EQ(put_cell(1, street_cell(0, 7)).status, 201);
  EXPECT_EQ(json_of(get(kCells))["cells"][0]["pose"][0], 7.0);
}

TEST_F(ApiCells, TheSameCellAgainChangesNothingAndAnotherIsAConflict) {
  put_street(1);
  const auto again = put_cell(1, street_cell(0, 0));
  EXPECT_EQ(again.status, 200);
  EXPECT_EQ(json_of(again)["revision"], 1);
  expect_problem(put_cell(1, street_cell(0, 3)), 409, "conflict");
  expect_problem(put_cell(1, street_cell(0, 0), {{"If-None-Match", "*"}}), 412,
                 "precondition-failed");
}

TEST_F(ApiCells, ACompressedBodyIsDecompressedWithinBounds) {
  const EncodedCell cell = street_cell(0, 0);
  const std::vector<Headed> zstd{{"Content-Type", "application/vnd.cellmap.cell"},
                                 {"Content-Encoding", "zstd"}};
  EXPECT_EQ(send("PUT", kCell1, to_text(zstd_compress(cell.bytes)), zstd).status, 201);
  const Bytes zeros(kMaxCellBytes + 1);
  expect_problem(send("PUT", "/v1/maps/town/cells/2", to_text(zstd_compress(zeros)), zstd), 413,
                 "too-large");
  expect_problem(send("PUT", "/v1/maps/town/cells/2", "not zstd", zstd), 422, "corrupt-data");
}

TEST_F(ApiCells, WrongCellsAreRefusedAndNothingIsLost) {
  put_street(1);
  const EncodedCell cell = street_cell(1, 6);
  const std::string text = to_text(cell.bytes);
  const std::string target = "/v1/maps/town/cells/2";
  const Headed type{"Content-Type", "application/vnd.cellmap.cell"};
  expect_problem(send("PUT", target, text.substr(0, 500), {type}), 422, "corrupt-data");
  std::string flipped = text;
  flipped[flipped.size() / 2] = static_cast<char>(flipped[flipped.size() / 2] ^ 1);
  expect_problem(send("PUT", target, flipped, {type}), 422, "corrupt-data");
  expect_problem(send("PUT", target, text, {{"Content-Type", "image/png"}}), 415, "unsupported");
  expect_problem(send("PUT", target, text, {type, {"Content-Encoding", "gzip"}}), 415,
                 "unsupported");
  expect_problem(send("PUT", target, text, {type, {"CELLmap-Pose", "0 0 nan 0 0 0 1"}}), 400,
                 "invalid-argument");
  expect_problem(send("PUT", target, text, {type, {"CELLmap-Pose", "0 0 0 0 0 0 7"}}), 400,
                 "invalid-argument");
  expect_problem(send("PUT", "/v1/maps/town/cells/banana", text, {type}), 400, "invalid-argument");
  expect_problem(send("PUT", "/v1/maps/none/cells/2", text, {type}), 404, "not-found");
  expect_problem(send("PUT", target, std::string(kMaxCellBytes + 1, 'x'), {type}), 413,
                 "too-large");
  post("/v1/maps", R"({"name":"fine"})");
  expect_problem(send("PUT", "/v1/maps/fine/cells/2", text, {type}), 400, "invalid-argument");
  const Json summary = json_of(get("/v1/maps/town"));
  EXPECT_EQ(summary["cells"], 1);
  EXPECT_EQ(summary["revision"], 1);
}

TEST_F(ApiCells, EachFormHasItsTagAndAnyOfThemMeansNotModified) {
  put_street(1);
  const std::string hash = to_hex(street_cell(0, 0).hash);
  const auto binary = get(kCell1);
  const auto zstd = get(kCell1, {{"Accept-Encoding", "gzip, zstd"}});
  const auto json = get(kCell1, {{"Accept", "application/json"}});
  EXPECT_EQ(binary.headers.get("ETag"), '"' + hash + '"');
  EXPECT_EQ(zstd.headers.get("ETag"), '"' + hash + "-zstd\"");
  EXPECT_EQ(json.headers.get("ETag"), '"' + hash + "-json\"");
  for (const auto* tagged : {&binary, &zstd, &json}) {
    const auto answer = get(kCell1, {{"If-None-Match", *tagged->headers.get("ETag")}});
    EXPECT_EQ(answer.status, 304);
    EXPECT_TRUE(body_view(answer).empty());
    EXPECT_TRUE(answer.headers.get("CELLmap-Pose"));
  }
  EXPECT_EQ(get(kCell1, {{"If-None-Match", "*"}}).status, 304);
  EXPECT_EQ(get(kCell1, {{"If-None-Match", "\"other\""}}).status, 200);
}

TEST_F(ApiCells, TheStoredFrameIsSentWhereTheClientTakesZstd) {
  put_street(1);
  const auto zstd = get(kCell1, {{"Accept-Encoding", "zstd"}});
  EXPECT_EQ(zstd.headers.get("Content-Encoding"), "zstd");
  EXPECT_EQ(std::get<SharedBytes>(zstd.body).bytes, store_->compressed_cell("town", {1}));
  EXPECT_EQ(zstd_decompress(as_bytes(body_view(zstd)), kMaxCellBytes), street_cell(0, 0).bytes);
  EXPECT_FALSE(get(kCell1, {{"Accept-Encoding", "zstd;q=0"}}).headers.get("Content-Encoding"));
}

TEST_F(ApiCells, ARangeIsOfTheIdentityBytes) {
  put_street(1);
  const std::string whole = to_text(street_cell(0, 0).bytes);
  const auto part = get(kCell1, {{"Range", "bytes=10-19"}, {"Accept-Encoding", "zstd"}});
  EXPECT_EQ(part.status, 206);
  EXPECT_EQ(body_view(part), whole.substr(10, 10));
  EXPECT_EQ(part.headers.get("Content-Range"), "bytes 10-19/" + std::to_string(whole.size()));
  EXPECT_EQ(body_view(get(kCell1, {{"Range", "bytes=0-1,5-9"}})), whole);
  EXPECT_EQ(body_view(get(kCell1, {{"Range", "bytes=0-1"}, {"If-Range", "\"old\""}})), whole);
  const auto beyond = get(kCell1, {{"Range", "bytes=99999999-"}});
  expect_problem(beyond, 416, "range-not-satisfiable");
  EXPECT_EQ(beyond.headers.get("Content-Range"), "bytes */" + std::to_string(whole.size()));
}

TEST_F(ApiCells, JsonShowsWhatTheBytesHold) {
  put_street(1);
  const Json json = json_of(get(kCell1, {{"Accept", "application/json"}}));
  const Cell cell = decode_cell(street_cell(0, 0).bytes);
  EXPECT_EQ(json["indices"], Json(cell.indices));
  ASSERT_EQ(json["planes"].size(), cell.planes.size());
  EXPECT_EQ(json["planes"][0][0].get<float>(), cell.planes[0].distance_m);
  expect_problem(get(kCell1, {{"Accept", "image/png"}}), 406, "not-acceptable");
}

TEST_F(ApiCells, HeadOfACellStatesWhatGetWouldSend) {
  put_street(1);
  const auto head = send("HEAD", kCell1);
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.headers.get("ETag"), get(kCell1).headers.get("ETag"));
  EXPECT_EQ(send("HEAD", kCell1, "", {{"Range", "bytes=0-9"}}).status, 206);
  EXPECT_EQ(send("HEAD", kCell1, "", {{"If-None-Match", "*"}}).status, 304);
  EXPECT_EQ(send("HEAD", kCell1, "", {{"Range", "bytes=99999999-"}}).status, 416);
  EXPECT_EQ(send("HEAD", "/v1/maps/town/cells/9").status, 404);
  EXPECT_EQ(send("HEAD", "/v1/maps/town/cells/x").status, 400);
  expect_problem(get("/v1/maps/town/cells/9"), 404, "not-found");
  expect_problem(get("/v1/maps/none/cells/1"), 404, "not-found");
  expect_problem(get("/v1/maps/town/cells/-1"), 400, "invalid-argument");
}

std::vector<int> ids_of(const Json& page) {
  std::vector<int> ids;
  for (const auto& cell : page["cells"]) ids.push_back(cell["id"]);
  return ids;
}

TEST_F(ApiCells, CellsAreFoundByPlaceSessionAndRevision) {
  put_street(4);  // at x = 0, 6, 12, 18
  const std::string cells = kCells;
  EXPECT_EQ(ids_of(json_of(get(cells))), (std::vector{1, 2, 3, 4}));
  EXPECT_EQ(ids_of(json_of(get(cells + "?near=11,0,0&radius=6"))), (std::vector{3, 2}));
  EXPECT_EQ(ids_of(json_of(get(cells + "?bbox=5,-1,-1,13,1,1"))), (std::vector{2, 3}));
  EXPECT_EQ(ids_of(json_of(get(cells + "?since=3"))), (std::vector{4}));
  EXPECT_EQ(ids_of(json_of(get(cells + "?session=other"))), std::vector<int>{});
  const Json first = json_of(get(cells + "?limit=3"));
  EXPECT_EQ(ids_of(first), (std::vector{1, 2, 3}));
  const auto next = get(cells + "?limit=3&cursor=" + first["next_cursor"].get<std::string>());
  EXPECT_EQ(ids_of(json_of(next)), (std::vector{4})) << body_view(next);
  EXPECT_TRUE(json_of(next)["next_cursor"].is_null());
}

TEST_F(ApiCells, WrongQueriesAreRefused) {
  for (const char* query :
       {"bbox=1,2,3", "bbox=1,0,0,0,1,1", "bbox=0,0,0,1,1,inf", "near=0,nan,0&radius=5",
        "near=0,0,0", "radius=5", "near=0,0,0&radius=0", "near=0,0,0&radius=-1", "limit=0",
        "limit=10001", "limit=ten", "since=-1", "cursor=banana", "colour=red", "limit=1&limit=2"}) {
    expect_problem(get(std::string(kCells) + "?" + query), 400, "invalid-argument");
  }
  expect_problem(get("/v1/maps/none/cells"), 404, "not-found");
  expect_problem(get(kCells, {{"Accept", "text/html"}}), 406, "not-acceptable");
}

std::vector<std::uint32_t> batched(const Response& response) {
  std::vector<std::uint32_t> ids;
  CellBatchReader reader(as_bytes(body_view(response)));
  while (const auto cell = reader.next()) {
    decode_cell(cell->bytes);
    ids.push_back(cell->id.value);
  }
  return ids;
}

TEST_F(ApiCells, ABatchBringsCellsByIdOrWhatTheClientLacks) {
  put_street(3);
  const std::string batch = "/v1/maps/town/cells:batch";
  const auto hash = to_hex(street_cell(1, 6).hash);
  EXPECT_EQ(batched(post(batch, R"({"ids":[3,1,3]})")), (std::vector{1u, 3u}));
  EXPECT_EQ(batched(post(batch, R"({"since":2})")), (std::vector{3u}));
  EXPECT_EQ(batched(post(batch, R"({"have":[")" + hash + R"("]})")), (std::vector{1u, 3u}));
  const auto cut = post(batch, R"({"since":0,"limit":2})");
  EXPECT_EQ(batched(cut), (std::vector{1u, 2u}));
  EXPECT_EQ(cut.headers.get("CELLmap-Remaining"), "1");
  EXPECT_EQ(cut.headers.get("CELLmap-Revision"), "3");
}

TEST_F(ApiCells, WrongBatchesAreRefused) {
  const std::string batch = "/v1/maps/town/cells:batch";
  for (const char* body :
       {"{}", R"({"ids":[1],"since":0})", R"({"ids":["1"]})", R"({"ids":[-1]})",
        R"({"have":["xyz"]})", R"({"ids":[1],"limit":0})", R"({"ids":[1],"limit":257})", "[]"}) {
    expect_problem(post(batch, body), 400, "invalid-argument");
  }
  expect_problem(post(batch, R"({"ids":[4000000]})"), 404, "not-found");
  expect_problem(post("/v1/maps/none/cells:batch", R"({"ids":[1]})"), 404, "not-found");
  expect_problem(post(batch, std::string(9u << 20, ' ')), 413, "too-large");
  expect_problem(send("POST", batch, "{}", {{"Content-Type", "text/plain"}}), 415, "unsupported");
}

}  // namespace
}  // namespace cellmap::server::test
