#include "cellmap/client/coded_cells.hpp"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "cellmap/codec/plane_displacement.hpp"
#include "codec/samples.hpp"
#include "e2e/cellmapd_process.hpp"
#include "e2e/drive.hpp"

namespace cellmap::test {
namespace {

constexpr std::uint32_t kCells = 5, kPlanes = 400;

/// A real server and CELLs that it was given whole.
class CodedCellsOverHttp : public testing::Test {
 protected:
  CodedCellsOverHttp() : server_(work_ / "map.db") {
    Client client = server_.client();
    client.create_map("town", {LatticeKind::kFibonacci, 1000});
    for (std::uint32_t i = 0; i < kCells; ++i) {
      Cell cell = random_cell(i, kPlanes, 1000);
      cell.session = "drive";
      cell.sequence = i;
      client.put_cell("town", CellId{i + 1}, encode_cell(cell));
      cells_.push_back(std::move(cell));
    }
  }
  CodedCellReader reader() const {
    ClientOptions options;
    options.url = server_.url();
    return CodedCellReader(options);
  }

  TempFolder work_;
  CellmapdProcess server_;
  std::vector<Cell> cells_;
};

TEST_F(CodedCellsOverHttp, AllComeWithinTheBound) {
  const auto records = server_.client().all_cells("town");
  std::size_t seen = 0;
  reader().for_each_cell("town", records, {CellEncoding::kCompact, 0.01},
                         [&](const CellRecord& record, const FetchedCodedCell& fetched) {
                           const Cell& source = cells_.at(record.id.value - 1);
                           EXPECT_LE(cell_displacement(source, fetched.decoded.cell).worst_m, 0.01);
                           ++seen;
                         });
  EXPECT_EQ(seen, kCells);
}

TEST_F(CodedCellsOverHttp, TheCommandLineFetchesACoarseCell) {
  const auto answer =
      cellmap_json(work_, {"fetch", "town", "2", "--server", server_.url(), "--encoding", "compact",
                           "--bound", "50mm", "--coarse", "--out", (work_ / "2.ccod").string()});
  EXPECT_EQ(answer["all_planes"], kPlanes);
  EXPECT_LT(answer["planes"], kPlanes / 2);
  EXPECT_LT(answer["bytes"], answer["all_bytes"]);
  EXPECT_EQ(answer["raw_hash"], to_hex(encode_cell(cells_[1]).hash));
  EXPECT_EQ(std::filesystem::file_size(work_ / "2.ccod"), answer["bytes"]);
}

}  // namespace
}  // namespace cellmap::test
