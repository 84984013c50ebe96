#include "cellmap/codec/cell_batch.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/kept_cell.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "cellmap/store/convert_cells.hpp"
#include "cellmap/store/read_cell.hpp"
#include "server/api/map_state.hpp"
#include "server/server_fixture.hpp"

// Maps that keep their CELLs coded, and conversions.

namespace cellmap::server::test {
namespace {

const CellForm kCompact{KeptEncoding::kCompact, 20'000};

class ApiKeptCells : public ApiTest {
 protected:
  void make(const std::string& form, const std::string& name = "town") {
    const auto made =
        post("/v1/maps", R"({"name":")" + name + R"(","lattice":{"kind":"fibonacci","size":6000})" +
                             form + "}");
    ASSERT_EQ(made.status, 201) << body_view(made);
  }
  void make_compact() { make(R"(,"encoding":"compact","bound_m":0.02)"); }
  Json map(const std::string& name = "town") { return json_of(get("/v1/maps/" + name)); }
  Response get_coded(const std::string& parameters, std::vector<Headed> headers = {}) {
    headers.push_back({"Accept", kCoded + parameters});
    return get(kCell1, headers);
  }
  Response convert(const std::string& json) { return post("/v1/maps/town/convert", json); }
  static std::string header(const Response& response, const char* name) {
    return std::string(response.headers.get(name).value_or(""));
  }
  /// What becomes of a CELL of the street.
  static KeptCell kept(std::uint32_t sequence, const CellForm& form = kCompact) {
    return keep_cell(
        std::make_shared<const Cell>(decode_cell(street_cell(sequence, sequence * 6).bytes)), form);
  }
};

TEST_F(ApiKeptCells, WhatAnotherServerConvertsIsReadAgain) {
  make("");
  put_street(2);
  Maps maps(*store_);  // of a server that converts nothing
  const auto state = maps.open("town");
  const auto target = state->target({1});
  const auto searcher = state->places().searcher;

  convert_cells(*store_, "town", kCompact);

  const auto places = state->places();
  EXPECT_NE(places.searcher, searcher) << "descriptions are made of bytes";
  const Cell now = read_cell(*store_, "town", {1});
  EXPECT_EQ(state->target({1})->cell().planes, now.planes);
  EXPECT_NE(target->cell().planes, now.planes) << "the conversion rounds";
}

TEST_F(ApiKeptCells, WhatWasConvertedBesideOwnCommitsIsReadAgain) {
  make("");
  put_street(2);
  Maps maps(*store_);
  const auto state = maps.open("town");
  (void)state->graph();
  (void)state->target({1});
  convert_cells(*store_, "town", kCompact);
  put_cell(3, street_cell(2, 12));
  state->publish(store_->pose_graph("town"));
  EXPECT_EQ(state->target({1})->cell().planes, read_cell(*store_, "town", {1}).planes);
}

TEST_F(ApiKeptCells, AMapSaysInWhichFormItKeepsItsCells) {
  make("");
  make(R"(,"encoding":"compact")", "town2");
  make(R"(,"encoding":"packed")", "town3");
  EXPECT_EQ(map()["encoding"], "raw");
  EXPECT_EQ(map()["bound_m"], 0.0);
  EXPECT_EQ(map("town2")["encoding"], "compact");
  EXPECT_DOUBLE_EQ(map("town2")["bound_m"], 0.02);
  EXPECT_EQ(map("town3")["encoding"], "packed");
  for (const char* wrong :
       {R"(,"encoding":"tiny")", R"(,"encoding":"packed","bound_m":0.02)", R"(,"bound_m":0.02)",
        R"(,"encoding":"compact","bound_m":0)", R"(,"encoding":"compact","bound_m":2)"}) {
    expect_problem(post("/v1/maps", std::string(R"({"name":"x")") + wrong + "}"), 400,
                   "invalid-argument");
  }
}

TEST_F(ApiKeptCells, ARawCellThatIsPutIntoACompactMapBecomesWhatItsBytesDecodeTo) {
  make_compact();
  const auto made = put_cell(1, street_cell(0, 0));
  ASSERT_EQ(made.status, 201) << body_view(made);
  const KeptCell expected = kept(0);
  EXPECT_EQ(json_of(made)["hash"], to_hex(expected.encoded.hash));
  const auto raw = get(kCell1);
  EXPECT_EQ(body_view(raw), to_text(expected.encoded.bytes));
  EXPECT_EQ(header(raw, "ETag"), '"' + to_hex(expected.encoded.hash) + '"');
  EXPECT_EQ(header(raw, "CELLmap-Bound"), "0.02");
  EXPECT_LE(
      cell_displacement(decode_cell(street_cell(0, 0).bytes), decode_cell(as_bytes(body_view(raw))))
          .worst_m,
      0.02);
  // Again: nothing changes. Another one: refused.
  EXPECT_EQ(put_cell(1, street_cell(0, 0)).status, 200);
  EXPECT_EQ(put_cell(1, expected.encoded).status, 200);
  expect_problem(put_cell(1, street_cell(0, 3)), 409, "conflict");
  EXPECT_EQ(map()["kept"], Json::parse(R"([{"encoding":"compact","bound_m":0.02,"cells":1}])"));
}

TEST_F(ApiKeptCells, ACodedAnswerOfACompactMapIsTheKeptBytesWhateverIsAskedFor) {
  make_compact();
  put_street(1);
  const KeptCell expected = kept(0);
  for (const char* asked : {";encoding=compact;bound=0.02", ";encoding=compact;bound=0.005",
                            ";encoding=compact;bound=0.1", ";encoding=packed", ""}) {
    const auto answer = get_coded(asked);
    ASSERT_EQ(answer.status, 200);
    EXPECT_EQ(body_view(answer), to_text(expected.coded->content.bytes)) << asked;
    EXPECT_EQ(header(answer, "Content-Type"), std::string(kCoded) + ";encoding=compact;bound=0.02");
    EXPECT_EQ(header(answer, "ETag"), '"' + to_hex(expected.coded->content.hash) + '"');
  }
  const auto coarse = get_coded(";layers=coarse");
  EXPECT_EQ(header(coarse, "Content-Type"),
            std::string(kCoded) + ";encoding=compact;bound=0.02;layers=coarse");
  const std::string tag = header(get_coded(""), "ETag");
  EXPECT_EQ(get_coded("", {{"If-None-Match", tag}}).status, 304);
}

TEST_F(ApiKeptCells, ABatchSaysTheWidestBoundThatItHolds) {
  make_compact();
  put_street(2);
  const auto answer =
      send("POST", "/v1/maps/town/cells:batch", R"({"ids":[1,2]})",
           {{"Content-Type", "application/json"},
            {"Accept", "application/vnd.cellmap.coded-cells;encoding=compact;bound=0.01"}});
  ASSERT_EQ(answer.status, 200) << body_view(answer);
  EXPECT_EQ(header(answer, "Content-Type"),
            "application/vnd.cellmap.coded-cells;encoding=compact;bound=0.02");
  CellBatchReader reader(as_bytes(body_view(answer)));
  for (std::uint32_t k = 0; const auto entry = reader.next(); ++k) {
    EXPECT_TRUE(std::ranges::equal(entry->bytes, kept(k).coded->content.bytes));
  }
}

TEST_F(ApiKeptCells, APackedMapIsTheSameMapInFewerBytes) {
  make(R"(,"encoding":"packed")");
  put_street(2);
  EXPECT_EQ(body_view(get(kCell1)), to_text(street_cell(0, 0).bytes));
  EXPECT_EQ(header(get(kCell1), "CELLmap-Bound"), "");
  EXPECT_EQ(json_of(get(kCell1, {{"Accept", "application/json"}}))["planes"].size(),
            decode_cell(street_cell(0, 0).bytes).planes.size());
  const auto packed = get_coded("");
  EXPECT_EQ(body_view(packed), to_text(kept(0, {KeptEncoding::kPacked, 0}).coded->content.bytes));
  const DecodedCell compact =
      decode_coded_cell(as_bytes(body_view(get_coded(";encoding=compact;bound=0.01"))));
  EXPECT_EQ(compact.raw_hash, street_cell(0, 0).hash);
  EXPECT_DOUBLE_EQ(compact.bound_m, 0.01);
}

TEST_F(ApiKeptCells, ACompactCellThatIsPutStaysInItsBytesInAnyMap) {
  make("");
  const KeptCell coded = kept(0, {KeptEncoding::kCompact, 50'000});
  const auto made =
      send("PUT", kCell1, to_text(coded.coded->content.bytes), {{"Content-Type", kCoded}});
  ASSERT_EQ(made.status, 201) << body_view(made);
  EXPECT_EQ(body_view(get_coded("")), to_text(coded.coded->content.bytes));
  EXPECT_EQ(map()["kept"][0]["encoding"], "compact");
  EXPECT_EQ(map()["encoding"], "raw");
}

TEST_F(ApiKeptCells, ASessionsCellsAreKnownByTheHashesUnderWhichTheyWereSent) {
  make_compact();
  const EncodedCell cell = street_cell(0, 0);
  const std::string path = "/v1/maps/town/sessions/drive/cells";
  const auto put = [&] {
    return send("PUT", path + "/" + to_hex(cell.hash), to_text(cell.bytes),
                {{"Content-Type", "application/vnd.cellmap.cell"}});
  };
  ASSERT_EQ(put().status, 201);
  EXPECT_EQ(put().status, 200);
  const auto lacking = post(path + ":lacking", R"({"hashes":[")" + to_hex(cell.hash) + R"("]})");
  EXPECT_EQ(json_of(lacking)["lacking"], Json::array());
  EXPECT_EQ(json_of(get("/v1/maps/town/cells"))["cells"][0]["hash"], to_hex(kept(0).encoded.hash));
}

TEST_F(ApiKeptCells, AnIngestKeepsItsCellsInTheFormThatItAsksFor) {
  write_drive(folder_.path() / "data/drive", 20);
  const auto asked =
      post("/v1/maps/fresh/jobs", R"({"kind":"ingest","path":"drive","create_map":true,)"
                                  R"("lattice":{"kind":"fibonacci","size":6000},)"
                                  R"("encoding":"compact","bound_m":0.02})");
  ASSERT_EQ(asked.status, 202) << body_view(asked);
  ASSERT_EQ(ended_job(json_of(asked))["state"], "succeeded");
  EXPECT_EQ(map("fresh")["encoding"], "compact");
  ASSERT_EQ(map("fresh")["kept"].size(), 1u);
  EXPECT_EQ(map("fresh")["kept"][0]["cells"], map("fresh")["cells"]);
  expect_problem(post("/v1/maps/fresh/jobs",
                      R"({"kind":"ingest","path":"drive","encoding":"raw","bound_m":0.02})"),
                 400, "invalid-argument");
}

TEST_F(ApiKeptCells, AConversionIsAJobAfterWhichFollowersAreToldOfTheCellsAnew) {
  make("");
  put_street(3);
  const Json before = map();
  const std::string tag = header(get(kCell1), "ETag");
  // Loaded before, so that what is loaded has to be dropped.
  EXPECT_LT(post("/v1/maps/town/loops", R"({"detect":1})").status, 300);
  const auto asked = convert(R"({"encoding":"compact","bound_m":0.02})");
  ASSERT_EQ(asked.status, 202) << body_view(asked);
  EXPECT_EQ(json_of(asked)["kind"], "convert");
  const Json ended = ended_job(json_of(asked));
  ASSERT_EQ(ended["state"], "succeeded") << ended.dump();
  EXPECT_EQ(ended["cells_done"], 3);
  EXPECT_EQ(map()["encoding"], "compact");
  EXPECT_EQ(map()["kept"], Json::parse(R"([{"encoding":"compact","bound_m":0.02,"cells":3}])"));
  EXPECT_LT(map()["stored_bytes"], before["stored_bytes"]);
  const auto changes = get("/v1/maps/town/changes?since=" + before["revision"].dump(),
                           {{"Accept", "application/json"}});
  ASSERT_EQ(json_of(changes)["added"].size(), 3u) << body_view(changes);
  EXPECT_EQ(json_of(changes)["added"][2]["hash"], to_hex(kept(2).encoded.hash));
  EXPECT_EQ(get(kCell1, {{"If-None-Match", tag}}).status, 200) << "another content";
  const Json detected = json_of(post("/v1/maps/town/loops", R"({"detect":1})"));
  EXPECT_TRUE(detected.contains("revision")) << detected.dump();
}

TEST_F(ApiKeptCells, WhatCannotBeConvertedIsRefusedBeforeAnythingChanges) {
  make_compact();
  put_street(1);
  expect_problem(convert(R"({"encoding":"packed"})"), 409, "conflict");
  expect_problem(convert(R"({"encoding":"compact","bound_m":0.01})"), 409, "conflict");
  expect_problem(convert("{}"), 400, "invalid-argument");
  expect_problem(convert(R"({"encoding":"compact","bound_m":9})"), 400, "invalid-argument");
  expect_problem(convert(R"({"encoding":"raw","banana":1})"), 400, "invalid-argument");
  expect_problem(post("/v1/maps/none/convert", R"({"encoding":"raw"})"), 404, "not-found");
  expect_problem(send("POST", "/v1/maps/town/convert", "{}", {{"Content-Type", "text/plain"}}), 415,
                 "unsupported");
  EXPECT_EQ(body_view(get_coded("")), to_text(kept(0).coded->content.bytes));
}

TEST_F(ApiKeptCells, ForEverIsOnlyWhatAHashNames) {
  make("");
  put_street(1);
  const std::string named = std::string(kCell1) + "?hash=" + to_hex(street_cell(0, 0).hash);
  EXPECT_EQ(header(get(named), "Cache-Control"), "public, max-age=31536000, immutable");
  EXPECT_EQ(header(get(kCell1), "Cache-Control"), "public, no-cache");
  ASSERT_EQ(ended_job(json_of(convert(R"({"encoding":"compact"})")))["state"], "succeeded");
  expect_problem(get(named), 404, "not-found");
}

TEST_F(ApiKeptCells, AnArchiveOfACompactMapHasItsBytesAndGivesTheMapBack) {
  make_compact();
  put_street(2);
  const auto archive = get("/v1/maps/town/archive");
  ASSERT_EQ(archive.status, 200);
  expect_problem(get("/v1/maps/town/archive?encoding=packed"), 409, "conflict");
  expect_problem(get("/v1/maps/town/archive?encoding=compact&bound=0.01"), 409, "conflict");
}

}  // namespace
}  // namespace cellmap::server::test
