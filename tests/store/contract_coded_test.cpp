#include <gmock/gmock.h>

#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/store/convert_cells.hpp"
#include "cellmap/store/copy_sessions.hpp"
#include "cellmap/store/read_cell.hpp"
#include "codec/samples.hpp"
#include "store/store_contract.hpp"
#include "support/expect_error.hpp"

namespace cellmap::test {
namespace {

constexpr LatticeSpec kLattice{LatticeKind::kFibonacci, 1000};
const CellForm kPacked{KeptEncoding::kPacked, 0};

const std::vector<CellForm>& all_forms() {
  static const std::vector<CellForm> forms{CellForm{}, kPacked, compact_form(0.005),
                                           compact_form(0.02)};
  return forms;
}

std::shared_ptr<const Cell> source_cell(std::uint32_t id) {
  auto cell = std::make_shared<Cell>(random_cell(id, 200, kLattice.size));
  cell->session = "drive";
  cell->sequence = id;
  return cell;
}

NewCell kept_as(std::uint32_t id, const CellForm& form) {
  KeptCell kept = keep_cell(source_cell(id), form);
  NewCell made;
  made.id = {id};
  made.cell = kept.cell;
  made.encoded = kept.encoded;
  made.coded = kept.coded;
  made.T_map_cell = pose_at(id, 0);
  return made;
}

/// CELLs 1 to `count` of `form` in a new map.
void make_map(Store& store, const std::string& name, const CellForm& form, std::uint32_t count) {
  store.create_map(name, kLattice, form);
  for (std::uint32_t id = 1; id <= count; ++id) store.commit(name, adding({kept_as(id, form)}));
}

Bytes kept_bytes(const Store& store, const std::string& map, std::uint32_t id) {
  return zstd_decompress(*store.stored_cell(map, {id}).frame, kMaxCellBytes);
}

TEST_P(StoreContract, KeepsACellInTheBytesOfItsFormAndGivesBackWhatTheyDecodeTo) {
  for (std::size_t k = 0; k < all_forms().size(); ++k) {
    const std::string map = "map" + std::to_string(k);
    make_map(*store_, map, all_forms()[k], 2);
  }
  reopen();
  for (std::size_t k = 0; k < all_forms().size(); ++k) {
    const CellForm form = all_forms()[k];
    const std::string map = "map" + std::to_string(k);
    const NewCell made = kept_as(2, form);
    EXPECT_EQ(store_->stored_cell(map, {2}).form, form);
    EXPECT_EQ(kept_bytes(*store_, map, 2),
              made.coded ? made.coded->content.bytes : made.encoded.bytes);
    EXPECT_EQ(store_->cell(map, {2}).hash, made.encoded.hash);
    EXPECT_EQ(read_encoded_cell(*store_, map, {2}).bytes, made.encoded.bytes);
    EXPECT_EQ(zstd_decompress(*store_->compressed_cell(map, {2}), kMaxCellBytes),
              made.encoded.bytes);
    EXPECT_EQ(encode_cell(read_cell(*store_, map, {2})).hash, made.encoded.hash);
    EXPECT_LE(cell_displacement(*source_cell(2), read_cell(*store_, map, {2})).worst_m,
              form.bound_m());
    const MapInfo info = store_->map(map);
    EXPECT_EQ(info.form, form);
    EXPECT_EQ(info.kept, (std::map<CellForm, std::uint64_t>{{form, 2}}));
    const std::vector<CellKeeping> keeping = store_->keeping(map, "drive");
    ASSERT_EQ(keeping.size(), 2u);
    EXPECT_EQ(keeping[1].source, encode_cell(*source_cell(2)).hash);
    EXPECT_EQ(keeping[1].form, form);
  }
  EXPECT_LT(store_->map("map3").stored_bytes, store_->map("map2").stored_bytes);
  EXPECT_LT(store_->map("map2").stored_bytes, store_->map("map1").stored_bytes);
  EXPECT_LT(store_->map("map1").stored_bytes, store_->map("map0").stored_bytes);
}

TEST_P(StoreContract, MapsInDifferentFormsShareNothingAndLeaveNothingBehind) {
  make_map(*store_, "raw", {}, 1);
  make_map(*store_, "packed", kPacked, 1);
  EXPECT_EQ(store_->cell("raw", {1}).hash, store_->cell("packed", {1}).hash);
  store_->delete_map("packed");
  EXPECT_EQ(read_encoded_cell(*store_, "raw", {1}).bytes, encode_cell(*source_cell(1)).bytes);
}

TEST_P(StoreContract, AConversionWithoutLossChangesNoHashAndTellsFollowersNothing) {
  make_map(*store_, "town", {}, 3);
  const Revision before = store_->map("town").revision;
  const std::uint64_t bytes = store_->map("town").stored_bytes;
  const ConversionReport report = convert_cells(*store_, "town", kPacked);
  EXPECT_EQ(report.converted, 3u);
  EXPECT_EQ(report.replaced, 0u);
  const MapChanges changes = store_->changes("town", before);
  EXPECT_TRUE(changes.added.empty());
  EXPECT_TRUE(changes.moved.empty());
  EXPECT_LT(store_->map("town").stored_bytes, bytes);
  EXPECT_EQ(store_->map("town").kept, (std::map<CellForm, std::uint64_t>{{kPacked, 3}}));
  EXPECT_EQ(read_encoded_cell(*store_, "town", {2}).bytes, encode_cell(*source_cell(2)).bytes);
  convert_cells(*store_, "town", {});
  EXPECT_EQ(store_->map("town").stored_bytes, bytes);
  EXPECT_EQ(kept_bytes(*store_, "town", 2), encode_cell(*source_cell(2)).bytes);
}

TEST_P(StoreContract, AConversionToCompactTellsEveryCellAnewAndKeepsItsPose) {
  make_map(*store_, "town", {}, 3);
  store_->commit("town", joining({make_constraint(1, 2)}));
  store_->commit("town", moving({{CellId{2}, pose_at(2, 0.5)}}));
  const Revision before = store_->map("town").revision;
  const PoseGraph graph = store_->pose_graph("town");
  const ConversionReport report = convert_cells(*store_, "town", compact_form(0.02));
  EXPECT_EQ(report.replaced, 3u);
  const MapChanges changes = store_->changes("town", before);
  ASSERT_EQ(changes.added.size(), 3u);
  EXPECT_EQ(changes.added[1].hash, kept_as(2, compact_form(0.02)).encoded.hash);
  EXPECT_EQ(changes.added[1].added, before + 2);
  EXPECT_TRUE(changes.added_constraints.empty());
  const PoseGraph after = store_->pose_graph("town");
  EXPECT_EQ(after.nodes.at({2}).matrix(), graph.nodes.at({2}).matrix());
  EXPECT_EQ(store_->pose_graph("town", before).nodes.size(), 3u);
  EXPECT_EQ(store_->pose_graph("town", before).unaligned, graph.unaligned);
  // Who asks for CELLs after a revision gets the replaced ones too.
  CellQuery query;
  query.since = before;
  EXPECT_EQ(ids_of(store_->cells("town", query).cells), (std::vector<std::uint32_t>{1, 2, 3}));
}

TEST_P(StoreContract, AConversionThatBrokeOffGoesOn) {
  make_map(*store_, "town", {}, 4);
  std::stop_source stop;
  const auto break_off = [&](const Progress& done) {
    if (done.cells_done == 2) stop.request_stop();
  };
  expect_error(ErrorCode::kCancelled, [&] {
    convert_cells(*store_, "town", compact_form(0.02), stop.get_token(), break_off);
  });
  EXPECT_EQ(store_->map("town").kept.at(compact_form(0.02)), 2u);
  EXPECT_EQ(store_->map("town").form, compact_form(0.02));
  const ContentHash first = store_->cell("town", {1}).hash;
  const ConversionReport report = convert_cells(*store_, "town", compact_form(0.02));
  EXPECT_EQ(report.left, 2u);
  EXPECT_EQ(report.converted, 2u);
  EXPECT_EQ(store_->cell("town", {1}).hash, first);
  const Revision revision = store_->map("town").revision;
  convert_cells(*store_, "town", compact_form(0.02));
  EXPECT_EQ(store_->map("town").revision, revision) << "nothing was left to do";
}

TEST_P(StoreContract, CompactCellsAreNeverCodedAgain) {
  make_map(*store_, "town", compact_form(0.02), 2);
  const Bytes bytes = kept_bytes(*store_, "town", 1);
  for (const CellForm& form : {CellForm{}, kPacked, compact_form(0.005)}) {
    expect_error(
        ErrorCode::kConflict, [&] { convert_cells(*store_, "town", form); }, "compact 20 mm");
    EXPECT_EQ(store_->map("town").form, compact_form(0.02));
  }
  // A wider bound is held already.
  EXPECT_EQ(convert_cells(*store_, "town", compact_form(0.05)).left, 2u);
  EXPECT_EQ(kept_bytes(*store_, "town", 1), bytes);
  EXPECT_EQ(store_->map("town").form, compact_form(0.05));
}

TEST_P(StoreContract, ACopyKeepsTheBytesOfEachCell) {
  make_map(*store_, "from", compact_form(0.02), 2);
  store_->create_map("to", kLattice);
  copy_sessions(*store_, "from", {"drive"}, "to");
  EXPECT_EQ(kept_bytes(*store_, "to", 1), kept_bytes(*store_, "from", 1));
  EXPECT_EQ(store_->keeping("to")[0].source, store_->keeping("from")[0].source);
}

TEST_P(StoreContract, AnUpdateOfACellThatHasOtherContentByNowIsRefused) {
  make_map(*store_, "town", {}, 1);
  MapUpdate update;
  const NewCell other = kept_as(1, kPacked);
  update.recoded[{1}] = {kept_as(2, {}).encoded.hash, other.encoded, other.coded};
  expect_error(ErrorCode::kPreconditionFailed, [&] { store_->commit("town", update); });
  MapUpdate missing;
  missing.recoded[{9}] = {other.encoded.hash, other.encoded, other.coded};
  expect_error(ErrorCode::kNotFound, [&] { store_->commit("town", missing); });
  EXPECT_EQ(store_->map("town").kept.at(CellForm{}), 1u);
}

TEST_P(StoreContract, AFormThatIsNoneIsRefused) {
  const CellForm bounded{KeptEncoding::kPacked, 20'000}, loose{KeptEncoding::kCompact, 10};
  for (const CellForm& form : {bounded, loose}) {
    expect_error(ErrorCode::kInvalidArgument, [&] { store_->create_map("x", kLattice, form); });
  }
  make_map(*store_, "town", {}, 1);
  expect_error(ErrorCode::kInvalidArgument, [&] { store_->set_form("town", loose); });
  expect_error(ErrorCode::kNotFound, [&] { store_->set_form("none", kPacked); });
}

}  // namespace
}  // namespace cellmap::test
