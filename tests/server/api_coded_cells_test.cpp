#include "cellmap/codec/cell_batch.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "server/server_fixture.hpp"

namespace cellmap::server::test {
namespace {

constexpr const char* kCompact20mm =
    "application/vnd.cellmap.coded-cell;encoding=compact;bound=0.02";

class ApiCodedCells : public ApiTest {
 protected:
  ApiCodedCells() {
    make_map();
    put_street(2);
  }
  Response get_coded(const std::string& accept, std::vector<Headed> headers = {}) {
    headers.push_back({"Accept", accept});
    return get(kCell1, headers);
  }
  static std::string header(const Response& response, const char* name) {
    return std::string(response.headers.get(name).value_or(""));
  }
  const Cell source_ = decode_cell(street_cell(0, 0).bytes);
};

TEST_F(ApiCodedCells, PackedIsTheCellToTheBitInFewerBytes) {
  const auto answer = get_coded(kCoded);
  ASSERT_EQ(answer.status, 200) << body_view(answer);
  EXPECT_EQ(header(answer, "Content-Type"), std::string(kCoded) + ";encoding=packed");
  const DecodedCell decoded = decode_coded_cell(as_bytes(body_view(answer)));
  EXPECT_EQ(encode_cell(decoded.cell).bytes, street_cell(0, 0).bytes);
  EXPECT_LT(body_view(answer).size(), street_cell(0, 0).bytes.size() * 3 / 4);
  EXPECT_EQ(header(answer, "ETag"), '"' + to_hex(decoded.hash) + '"');
  EXPECT_TRUE(answer.headers.get("CELLmap-Pose"));
}

TEST_F(ApiCodedCells, CompactHoldsTheBoundThatWasAskedFor) {
  for (const double bound_m : {0.005, 0.05}) {
    const auto answer =
        get_coded(std::string(kCoded) + "; encoding=compact; bound=" + std::to_string(bound_m));
    const DecodedCell decoded = decode_coded_cell(as_bytes(body_view(answer)));
    EXPECT_EQ(decoded.raw_hash, street_cell(0, 0).hash);
    EXPECT_DOUBLE_EQ(decoded.bound_m, bound_m);
    EXPECT_LE(cell_displacement(source_, decoded.cell).worst_m, bound_m);
  }
  const auto usual = get_coded(std::string(kCoded) + ";encoding=compact");
  EXPECT_EQ(header(usual, "Content-Type"), kCompact20mm);
}

TEST_F(ApiCodedCells, EachFormHasATagOfItsOwnThatStays) {
  const auto packed = get_coded(kCoded), compact = get_coded(kCompact20mm);
  EXPECT_NE(header(packed, "ETag"), header(compact, "ETag"));
  EXPECT_EQ(header(get_coded(kCompact20mm), "ETag"), header(compact, "ETag"));
  const auto again = get_coded(kCompact20mm, {{"If-None-Match", header(compact, "ETag")}});
  EXPECT_EQ(again.status, 304);
  EXPECT_EQ(header(again, "Vary"), "Accept, Accept-Encoding");
  EXPECT_EQ(get_coded(kCompact20mm, {{"If-None-Match", header(packed, "ETag")}}).status, 200);
}

TEST_F(ApiCodedCells, TheCoarseLayerIsAnAnswerOfItsOwnAndTheFirstBytesOfTheFile) {
  const auto whole = get_coded(kCompact20mm);
  const auto coarse = get_coded(std::string(kCompact20mm) + ";layers=coarse");
  ASSERT_EQ(coarse.status, 200);
  const std::string bytes(body_view(coarse));
  EXPECT_EQ(header(coarse, "CELLmap-File-Bytes"), std::to_string(body_view(whole).size()));
  EXPECT_EQ(header(whole, "CELLmap-Coarse-Bytes"), std::to_string(bytes.size()));
  EXPECT_EQ(bytes, body_view(whole).substr(0, bytes.size()));
  EXPECT_NE(header(coarse, "ETag"), header(whole, "ETag"));
  const DecodedCell decoded = decode_coarse_cell(as_bytes(bytes), body_view(whole).size());
  EXPECT_EQ(decoded.all_planes, source_.planes.size());
  EXPECT_LT(decoded.cell.planes.size(), source_.planes.size() / 2);
}

TEST_F(ApiCodedCells, ARangeIsOfTheFormThatIfRangeNames) {
  const auto whole = get_coded(kCompact20mm);
  const auto part = get_coded(kCompact20mm, {{"Range", "bytes=4-7"}});
  EXPECT_EQ(part.status, 206);
  EXPECT_EQ(body_view(part), "CCOD");
  const std::vector<Headed> of_this{{"Range", "bytes=4-7"}, {"If-Range", header(whole, "ETag")}};
  EXPECT_EQ(get_coded(kCompact20mm, of_this).status, 206);
  EXPECT_EQ(get_coded(kCoded, of_this).status, 200);
  expect_problem(get_coded(kCompact20mm, {{"Range", "bytes=99999999-"}}), 416,
                 "range-not-satisfiable");
}

TEST_F(ApiCodedCells, WhatIsNoFormOfACellIsRefused) {
  for (const char* parameters :
       {";encoding=compact;bound=0", ";encoding=compact;bound=2", ";encoding=compact;bound=x",
        ";bound=0.02", ";encoding=tiny", ";layers=fine", ";banana=1"}) {
    expect_problem(get_coded(std::string(kCoded) + parameters), 400, "invalid-argument");
  }
}

TEST_F(ApiCodedCells, ABatchHasThemToo) {
  const auto answer =
      send("POST", "/v1/maps/town/cells:batch", R"({"ids":[1,2]})",
           {{"Content-Type", "application/json"},
            {"Accept", "application/vnd.cellmap.coded-cells;encoding=compact;bound=0.01"}});
  ASSERT_EQ(answer.status, 200) << body_view(answer);
  EXPECT_EQ(header(answer, "Content-Type"),
            "application/vnd.cellmap.coded-cells;encoding=compact;bound=0.01");
  CellBatchReader reader(as_bytes(body_view(answer)));
  std::size_t cells = 0;
  while (const auto entry = reader.next()) {
    const DecodedCell decoded = decode_coded_cell(entry->bytes);
    EXPECT_EQ(decoded.raw_hash, street_cell(entry->id.value - 1, 6 * (entry->id.value - 1)).hash);
    ++cells;
  }
  EXPECT_EQ(cells, 2u);
  expect_problem(send("POST", "/v1/maps/town/cells:batch", R"({"ids":[1]})",
                      {{"Content-Type", "application/json"},
                       {"Accept", "application/vnd.cellmap.coded-cells;layers=coarse"}}),
                 400, "invalid-argument");
}

TEST_F(ApiCodedCells, APackedCellThatIsPutIsTheSameCell) {
  const EncodedCell third = street_cell(2, 12);
  const std::string packed = to_text(encode_packed_cell(decode_cell(third.bytes)).bytes);
  const Headed type{"Content-Type", kCoded};
  const auto made = send("PUT", "/v1/maps/town/cells/3", packed, {type});
  ASSERT_EQ(made.status, 201) << body_view(made);
  EXPECT_EQ(json_of(made)["hash"], to_hex(third.hash));
  EXPECT_EQ(body_view(get("/v1/maps/town/cells/3")), to_text(third.bytes));
  EXPECT_EQ(put_cell(3, third).status, 200);
  expect_problem(send("PUT", "/v1/maps/town/cells/4", packed.substr(0, 500), {type}), 422,
                 "corrupt-data");
}

TEST_F(ApiCodedCells, ACompactCellThatIsPutIsKeptAsWhatItBecomes) {
  const EncodedCell compact = encode_compact_cell(decode_cell(street_cell(2, 12).bytes), 0.02);
  const auto made =
      send("PUT", "/v1/maps/town/cells/3", to_text(compact.bytes), {{"Content-Type", kCoded}});
  ASSERT_EQ(made.status, 201) << body_view(made);
  const EncodedCell expected = encode_cell(decode_coded_cell(compact.bytes).cell);
  EXPECT_EQ(json_of(made)["hash"], to_hex(expected.hash));
  EXPECT_EQ(body_view(get("/v1/maps/town/cells/3")), to_text(expected.bytes));
}

}  // namespace
}  // namespace cellmap::server::test
