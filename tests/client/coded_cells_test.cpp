#include "cellmap/client/coded_cells.hpp"

#include <gtest/gtest.h>

#include "cellmap/codec/cell_batch.hpp"
#include "cellmap/core/error.hpp"
#include "client/fake_server.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::FakeServer;

/// A CELL whose planes face the origin from some metres away.
Cell facing_cell(std::uint32_t sequence) {
  Cell cell;
  cell.lattice.size = 1000;
  cell.session = "drive";
  cell.sequence = sequence;
  const Lattice lattice(cell.lattice);
  for (std::uint32_t i = 100; i < 900; i += 1 + i % 2) {
    const Eigen::Vector3f n = (-lattice.direction(i)).cast<float>();
    cell.indices.push_back(i);
    cell.planes.push_back({5 + 0.01f * static_cast<float>(i % 7), n.x(), n.y(), n.z()});
  }
  return cell;
}

std::string body_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

CellRecord record_of(std::uint32_t id, const Cell& cell) {
  CellRecord record;
  record.id = CellId{id};
  record.hash = encode_cell(cell).hash;
  return record;
}

TEST(CodedCellReader, AsksForTheFormAndVerifiesIt) {
  const EncodedCell coded = encode_compact_cell(facing_cell(1), 0.01);
  std::string accept;
  FakeServer server([&](const httplib::Request& request, httplib::Response& response) {
    accept = request.get_header_value("Accept");
    response.set_content(body_of(coded.bytes), "application/vnd.cellmap.coded-cell");
  });
  CodedCellReader reader(test::options_for(server));
  const FetchedCodedCell fetched = reader.cell("town", CellId{1}, {CellEncoding::kCompact, 0.01});
  EXPECT_EQ(accept, "application/vnd.cellmap.coded-cell;encoding=compact;bound=0.01");
  EXPECT_EQ(fetched.decoded.hash, coded.hash);
  EXPECT_EQ(fetched.decoded.raw_hash, encode_cell(facing_cell(1)).hash);
  EXPECT_EQ(fetched.decoded.cell.indices, facing_cell(1).indices);
}

TEST(CodedCellReader, ACoarseCellIsItsFirstBytes) {
  const EncodedCell coded = encode_compact_cell(facing_cell(1), 0.02);
  FakeServer server([&](const httplib::Request& request, httplib::Response& response) {
    EXPECT_NE(request.get_header_value("Accept").find(";layers=coarse"), std::string::npos);
    response.set_header("CELLmap-File-Bytes", std::to_string(coded.bytes.size()));
    response.set_content(body_of(coded.bytes).substr(0, coarse_cell_bytes(coded.bytes)),
                         "application/vnd.cellmap.coded-cell");
  });
  CodedCellReader reader(test::options_for(server));
  const FetchedCodedCell fetched = reader.coarse_cell("town", CellId{1});
  EXPECT_TRUE(fetched.decoded.is_coarse);
  EXPECT_LT(fetched.bytes.size(), fetched.file_bytes);
  for (const std::uint32_t index : fetched.decoded.cell.indices) EXPECT_EQ(index % 4, 0u);
}

TEST(CodedCellReader, AWiderBoundThanAskedForAndDamageAreRefused) {
  const EncodedCell coded = encode_compact_cell(facing_cell(1), 0.05);
  std::string body = body_of(coded.bytes);
  FakeServer server([&](const httplib::Request&, httplib::Response& response) {
    response.set_content(body, "application/vnd.cellmap.coded-cell");
  });
  CodedCellReader reader(test::options_for(server));
  const auto fetch = [&](double bound_m) {
    reader.cell("town", CellId{1}, {CellEncoding::kCompact, bound_m});
  };
  EXPECT_NO_THROW(fetch(0.05));
  test::expect_error(
      ErrorCode::kConflict, [&] { fetch(0.02); }, "compact 50 mm");
  body.back() = static_cast<char>(body.back() ^ 1);
  test::expect_error(ErrorCode::kCorruptData, [&] { fetch(0.05); });
}

TEST(CodedCellReader, ManyComeInBatchesAndMustBeThoseOfTheList) {
  const std::vector<Cell> cells{facing_cell(1), facing_cell(2)};
  FakeServer server([&](const httplib::Request& request, httplib::Response& response) {
    EXPECT_EQ(request.get_header_value("Accept"),
              "application/vnd.cellmap.coded-cells;encoding=packed");
    Bytes batch;  // one at a time, as a server that cuts its answers
    const std::uint32_t id = request.body.find('1') != std::string::npos ? 1 : 2;
    append_to_batch(batch, CellId{id}, encode_packed_cell(cells[id - 1]).bytes);
    response.set_content(body_of(batch), "application/vnd.cellmap.coded-cells");
  });
  CodedCellReader reader(test::options_for(server));
  std::vector<CellRecord> records{record_of(1, cells[0]), record_of(2, cells[1])};
  std::vector<std::uint32_t> seen;
  const auto read = [&] {
    reader.for_each_cell("town", records, {CellEncoding::kPacked},
                         [&](const CellRecord& record, const FetchedCodedCell& fetched) {
                           EXPECT_EQ(encode_cell(fetched.decoded.cell).hash, record.hash);
                           seen.push_back(record.id.value);
                         });
  };
  read();
  EXPECT_EQ(seen, (std::vector<std::uint32_t>{1, 2}));
  records[1].hash = records[0].hash;
  test::expect_error(ErrorCode::kConflict, [&] { read(); });
}

}  // namespace
}  // namespace cellmap
