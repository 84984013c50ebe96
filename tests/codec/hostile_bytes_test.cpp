// Seeded mutations of valid files. Every decoder must answer with an Error of the documented codes
// or with a value that its encoder accepts; under AddressSanitizer and UBSan this also proves that
// it reads nothing outside the buffer. An exception of any other kind fails the test.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <functional>

#include "cellmap/codec/cell_batch.hpp"
#include "cellmap/codec/changes_codec.hpp"
#include "cellmap/codec/pose_graph_codec.hpp"
#include "cellmap/codec/scan_codec.hpp"
#include "cellmap/codec/zstd.hpp"
#include "codec/raw_buffer.hpp"
#include "codec/samples.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kLimit = 100'000;
constexpr int kMutations = 5'000;
constexpr std::size_t kTestedPrefix = 600;  // headers, vtables and the first values

/// One to three numbers overwritten with values that offsets, lengths and counts fear.
Bytes mutated(Bytes bytes, std::mt19937& rng) {
  constexpr std::array<std::uint32_t, 14> kFeared = {
      0,      1,      2,       4,          8,          0x7f,       0xff,
      0x7fff, 0xffff, 0x10000, 0x7fffffff, 0x80000000, 0xfffffffc, 0xffffffff};
  const std::size_t range = std::min(bytes.size() - 4, kTestedPrefix);
  for (int count = 1 + static_cast<int>(rng() % 3); count > 0; --count) {
    const std::size_t at = rng() % range;
    const std::uint32_t value = rng() % 3 ? kFeared[rng() % kFeared.size()]
                                          : static_cast<std::uint32_t>(rng() % bytes.size());
    const std::size_t width = std::size_t{1} << rng() % 3;
    std::memcpy(bytes.data() + at, &value, width);
  }
  return bytes;
}

struct Verdicts {
  int accepted = 0, refused = 0;
};

Verdicts judge(const Bytes& good, std::uint32_t seed,
               const std::function<void(const Bytes&)>& read) {
  std::mt19937 rng(seed);
  Verdicts verdicts;
  for (int i = 0; i < kMutations; ++i) {
    const auto thrown = thrown_by([&] { read(mutated(good, rng)); });
    if (!thrown) {
      ++verdicts.accepted;
      continue;
    }
    ++verdicts.refused;
    EXPECT_TRUE(thrown->code == ErrorCode::kCorruptData ||
                thrown->code == ErrorCode::kUnsupported || thrown->code == ErrorCode::kTooLarge)
        << thrown->message;
  }
  return verdicts;
}

TEST(HostileBytes, APoseGraphIsRefusedOrValid) {
  PoseGraph graph;
  std::mt19937 rng(1);
  for (std::uint32_t i = 1; i <= 3; ++i) graph.nodes[CellId{i}] = random_pose(rng);
  graph.constraints.resize(1);
  graph.constraints[0].from = CellId{1};
  graph.constraints[0].to = CellId{2};
  const Verdicts verdicts = judge(encode_pose_graph(graph), 2, [](const Bytes& bytes) {
    encode_pose_graph(decode_pose_graph(bytes));
  });
  EXPECT_GT(verdicts.accepted, 0);
  EXPECT_GT(verdicts.refused, 0);
}

TEST(HostileBytes, ChangesAreRefusedOrValid) {
  MapChanges changes;
  std::mt19937 rng(1);
  changes.revision = 2;
  for (std::uint32_t i = 1; i <= 9; ++i) changes.moved[CellId{i}] = random_pose(rng);
  changes.added.resize(1);
  changes.added[0].id = CellId{20};
  changes.added[0].added = changes.added[0].moved = 2;
  changes.added[0].session = "s";
  changes.added_constraints.resize(1);
  changes.added_constraints[0].id = ConstraintId{1};
  changes.added_constraints[0].to = CellId{1};
  changes.removed = {CellId{30}};
  changes.unaligned = {CellId{1}, CellId{2}};
  const Verdicts verdicts = judge(encode_changes(changes), 3, [](const Bytes& bytes) {
    encode_changes(decode_changes(bytes));
  });
  EXPECT_GT(verdicts.accepted, 0);
  EXPECT_GT(verdicts.refused, 0);
}

TEST(HostileBytes, AScanIsRefusedOrValid) {
  const Verdicts verdicts = judge(encode_scan(random_scan(3, 20)), 4,
                                  [](const Bytes& bytes) { encode_scan(decode_scan(bytes)); });
  EXPECT_GT(verdicts.accepted, 0);
  EXPECT_GT(verdicts.refused, 0);
}

TEST(HostileBytes, ACellWithAMendedHashIsRefusedOrValid) {
  // The hash is no defence against those who can compute it: where it is the only complaint, mend
  // it.
  const Verdicts verdicts = judge(encode_cell(random_cell(5, 12)).bytes, 6, [](const Bytes& bytes) {
    const auto thrown = thrown_by([&] { decode_cell(bytes); });
    const auto seen = thrown_by([&] { view_cell(bytes); });
    EXPECT_EQ(seen.has_value(), thrown.has_value());
    EXPECT_EQ(seen ? seen->message : "", thrown ? thrown->message : "");
    if (!thrown) return;
    const auto at = thrown->message.find("its bytes have ");
    if (at == std::string::npos) throw Error(thrown->code, thrown->message);
    Bytes mended = bytes;
    const RawBuffer raw(mended);
    const ContentHash hash = content_hash_from_hex(thrown->message.substr(at + 15, 64));
    std::memcpy(mended.data() + raw.field(raw.root(), 1), hash.bytes.data(), 32);
    encode_cell(decode_cell(mended));
    encode_cell(view_cell(mended).to_cell());
  });
  EXPECT_GT(verdicts.accepted, 0);
  EXPECT_GT(verdicts.refused, 0);
}

TEST(HostileBytes, ABatchIsRefusedOrStaysInside) {
  Bytes batch;
  for (std::uint32_t i = 0; i < 5; ++i) append_to_batch(batch, CellId{i}, Bytes(20 * i));
  const Verdicts verdicts = judge(batch, 7, [](const Bytes& bytes) {
    CellBatchReader reader(bytes);
    std::size_t sum = 0;
    while (const auto cell = reader.next()) sum += 8 + cell->bytes.size();
    EXPECT_EQ(sum, bytes.size());
  });
  EXPECT_GT(verdicts.accepted, 0);
  EXPECT_GT(verdicts.refused, 0);
}

TEST(HostileBytes, AZstdFrameIsRefusedOrWithinItsLimit) {
  const Bytes frame = zstd_compress(encode_cell(random_cell(8, 30)).bytes);
  judge(frame, 9,
        [](const Bytes& bytes) { EXPECT_LE(zstd_decompress(bytes, kLimit).size(), kLimit); });
}

}  // namespace
}  // namespace cellmap
