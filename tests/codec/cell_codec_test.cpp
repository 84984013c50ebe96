#include "cellmap/codec/cell_codec.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>

#include "cellmap/codec/zstd.hpp"
#include "codec/raw_buffer.hpp"
#include "codec/samples.hpp"
#include "support/expect_error.hpp"

namespace cellmap {
namespace {

using test::expect_error;

constexpr int kVersion = 0, kHash = 1, kLattice = 2, kIndices = 3, kPlanes = 4, kSession = 5,
              kPose = 7, kFirstStamp = 8, kStatistics = 12;
constexpr int kLatticeKind = 0, kLatticeVersion = 1, kLatticeSize = 2;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

void expect_equal(const Cell& a, const Cell& b) {
  EXPECT_EQ(a.lattice, b.lattice);
  EXPECT_EQ(a.indices, b.indices);
  EXPECT_EQ(a.planes, b.planes);
  EXPECT_EQ(a.session, b.session);
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.T_odom_cell.matrix(), b.T_odom_cell.matrix());
  EXPECT_EQ(a.first_stamp, b.first_stamp);
  EXPECT_EQ(a.last_stamp, b.last_stamp);
  EXPECT_EQ(a.first_scan, b.first_scan);
  EXPECT_EQ(a.scan_count, b.scan_count);
  EXPECT_EQ(a.statistics, b.statistics);
}

/// Gives a buffer the hash that its bytes have, as FORMAT.md, "Content hash", says.
void seal(Bytes& bytes) {
  const RawBuffer raw(bytes);
  const std::size_t at = raw.field(raw.root(), kHash);
  std::fill_n(bytes.begin() + at, 32, std::byte{0});
  const ContentHash hash = sha256(bytes);
  std::memcpy(bytes.data() + at, hash.bytes.data(), 32);
}

/// An encoded CELL of 12 planes, broken by `damage(buffer, root)` and sealed again.
Bytes broken(const std::function<void(RawBuffer&, std::size_t)>& damage) {
  Bytes bytes = encode_cell(random_cell(1, 12)).bytes;
  RawBuffer raw(bytes);
  damage(raw, raw.root());
  seal(bytes);
  return bytes;
}

std::size_t plane_at(const RawBuffer& raw, std::size_t k) {
  return raw.target(raw.root(), kPlanes) + 4 + 16 * k;
}
std::size_t index_at(const RawBuffer& raw, std::size_t k) {
  return raw.target(raw.root(), kIndices) + 4 + 4 * k;
}

TEST(CellCodec, ACellSurvivesTheRoundTripExactly) {
  for (const std::uint32_t planes : {0u, 1u, 2u, 3u, 100u, 5810u}) {
    const Cell cell = random_cell(planes, planes);
    expect_equal(decode_cell(encode_cell(cell).bytes), cell);
  }
}

TEST(CellCodec, ACellOfDefaultsSurvivesTheRoundTrip) {
  Cell cell;
  cell.session = "s";
  expect_equal(decode_cell(encode_cell(cell).bytes), cell);
}

TEST(CellCodec, AFullLatticeOfAMillionPointsFits) {
  const Cell cell = random_cell(3, 1'000'000, 1'000'000);
  ASSERT_EQ(cell.planes.size(), 1'000'000u);
  const EncodedCell encoded = encode_cell(cell);
  EXPECT_LE(encoded.bytes.size(), kMaxCellBytes);
  expect_equal(decode_cell(encoded.bytes), cell);
}

TEST(CellCodec, EncodingIsDeterministicAndStableUnderDecoding) {
  const EncodedCell first = encode_cell(random_cell(4, 500));
  const EncodedCell second = encode_cell(random_cell(4, 500));
  const EncodedCell third = encode_cell(decode_cell(first.bytes));
  EXPECT_EQ(first.bytes, second.bytes);
  EXPECT_EQ(first.bytes, third.bytes);
  EXPECT_EQ(first.hash, third.hash);
}

TEST(CellCodec, TheHashIsThatOfTheBytesWithTheHashSetToZero) {
  const EncodedCell encoded = encode_cell(random_cell(5, 50));
  Bytes resealed = encoded.bytes;
  seal(resealed);
  EXPECT_EQ(resealed, encoded.bytes);
  EXPECT_EQ(verified_hash(encoded.bytes), encoded.hash);
}

TEST(CellCodec, ARefusedCellIsNotEncoded) {
  Cell cell = random_cell(6, 10);
  cell.planes[3].nx = kNan;
  expect_error(ErrorCode::kCorruptData, [&] { encode_cell(cell); });
  cell = random_cell(6, 10);
  cell.lattice.kind = LatticeKind{9};
  expect_error(ErrorCode::kUnsupported, [&] { encode_cell(cell); });
}

TEST(CellCodec, ACellOutOfAStoreIsVerifiedButNotHashed) {
  const Cell cell = random_cell(9, 40);
  Bytes bytes = encode_cell(cell).bytes;
  expect_equal(decode_stored_cell(zstd_compress(bytes)), cell);
  RawBuffer raw(bytes);
  raw.set<float>(plane_at(raw, 3), kNan);
  expect_error(ErrorCode::kCorruptData, [&] { decode_stored_cell(zstd_compress(bytes)); });
  bytes.resize(bytes.size() / 2);
  expect_error(ErrorCode::kCorruptData, [&] { decode_stored_cell(zstd_compress(bytes)); });
}

TEST(CellCodec, ACellOfBandsSurvivesTheRoundTripAndKeepsInsideItsDirections) {
  Cell cell = random_cell(10, 0);
  cell.lattice = {LatticeKind::kFibonacciBands, 1'000};
  const Lattice lattice(cell.lattice);
  for (const std::uint32_t i : {0U, 400U, lattice.size() - 1}) {
    const Eigen::Vector3f n = -lattice.direction(i).cast<float>();
    cell.indices.push_back(i);
    cell.planes.push_back({5.0f, n.x(), n.y(), n.z()});
  }
  expect_equal(decode_cell(encode_cell(cell).bytes), cell);
  cell.indices.back() = lattice.size();
  expect_error(
      ErrorCode::kCorruptData, [&] { encode_cell(cell); }, "outside its lattice");
}

TEST(CellCodec, EveryBrokenRuleIsNamed) {
  struct Case {
    const char* message;
    std::function<void(RawBuffer&, std::size_t)> damage;
  };
  const std::vector<Case> cases = {
      {"normal", [](RawBuffer& raw, std::size_t) { raw.set(plane_at(raw, 5) + 4, kNan); }},
      {"normal", [](RawBuffer& raw, std::size_t) { raw.set(plane_at(raw, 5) + 8, 2.0f); }},
      {"distance", [](RawBuffer& raw, std::size_t) { raw.set(plane_at(raw, 5), kNan); }},
      {"distance", [](RawBuffer& raw, std::size_t) { raw.set(plane_at(raw, 5), 0.0f); }},
      {"distance", [](RawBuffer& raw, std::size_t) { raw.set(plane_at(raw, 5), -1.0f); }},
      {"distance", [](RawBuffer& raw, std::size_t) { raw.set(plane_at(raw, 5), 10'001.0f); }},
      {"face",
       [](RawBuffer& raw, std::size_t) {
         for (const int axis : {4, 8, 12}) {
           const std::size_t at = plane_at(raw, 5) + axis;
           raw.set(at, -raw.get<float>(at));
         }
       }},
      {"outside",
       [](RawBuffer& raw, std::size_t) { raw.set<std::uint32_t>(index_at(raw, 11), 50'000); }},
      {"increasing",
       [](RawBuffer& raw, std::size_t) {
         raw.set(index_at(raw, 5), raw.get<std::uint32_t>(index_at(raw, 4)));
         raw.set(plane_at(raw, 5), raw.get<Plane>(plane_at(raw, 4)));
       }},
      {"increasing",
       [](RawBuffer& raw, std::size_t) {
         const auto a = raw.get<std::uint32_t>(index_at(raw, 4));
         const auto b = raw.get<std::uint32_t>(index_at(raw, 5));
         const auto plane_a = raw.get<Plane>(plane_at(raw, 4));
         raw.set(index_at(raw, 4), b);
         raw.set(index_at(raw, 5), a);
         raw.set(plane_at(raw, 4), raw.get<Plane>(plane_at(raw, 5)));
         raw.set(plane_at(raw, 5), plane_a);
       }},
      {"12 indices",
       [](RawBuffer& raw, std::size_t root) {
         raw.set<std::uint32_t>(raw.target(root, kPlanes), 11);
       }},
      {"11 indices",
       [](RawBuffer& raw, std::size_t root) {
         raw.set<std::uint32_t>(raw.target(root, kIndices), 11);
       }},
      {"rigid", [](RawBuffer& raw, std::size_t root) { raw.set(raw.field(root, kPose), 1.5); }},
      {"rigid",
       [](RawBuffer& raw, std::size_t root) {
         raw.set(raw.field(root, kPose) + 3 * 8, std::numeric_limits<double>::infinity());
       }},
      {"session",
       [](RawBuffer& raw, std::size_t root) { raw.set(raw.target(root, kSession) + 4, '/'); }},
      {"session",
       [](RawBuffer& raw, std::size_t root) { raw.set(raw.target(root, kSession) + 4, '\0'); }},
      {"stamp",
       [](RawBuffer& raw, std::size_t root) {
         raw.set(raw.field(root, kFirstStamp), std::numeric_limits<std::int64_t>::max());
       }},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    SCOPED_TRACE("case " + std::to_string(i));
    const Bytes bytes = broken(cases[i].damage);
    expect_error(
        ErrorCode::kCorruptData, [&] { decode_cell(bytes); }, cases[i].message);
    EXPECT_NO_THROW(verified_hash(bytes)) << "the case must break values, not structure";
  }
}

TEST(CellCodec, WhatALaterVersionMayBringIsCalledUnsupported) {
  const auto lattice = [](RawBuffer& raw, std::size_t root) { return raw.target(root, kLattice); };
  const Bytes newer = broken([](RawBuffer& raw, std::size_t root) {
    raw.set<std::uint16_t>(raw.field(root, kVersion), 2);
  });
  const Bytes newer_without_planes = broken([](RawBuffer& raw, std::size_t root) {
    raw.set<std::uint16_t>(raw.field(root, kVersion), 2);
    raw.drop_field(root, kPlanes);
  });
  const Bytes kind = broken([&](RawBuffer& raw, std::size_t root) {
    raw.set<std::uint8_t>(raw.field(lattice(raw, root), kLatticeKind), 77);
  });
  const Bytes lattice_version = broken([&](RawBuffer& raw, std::size_t root) {
    raw.set<std::uint8_t>(raw.field(lattice(raw, root), kLatticeVersion), 2);
  });
  const Bytes size = broken([&](RawBuffer& raw, std::size_t root) {
    raw.set<std::uint32_t>(raw.field(lattice(raw, root), kLatticeSize), 999);
  });
  for (const Bytes* bytes : {&newer, &newer_without_planes}) {
    expect_error(
        ErrorCode::kUnsupported, [&] { decode_cell(*bytes); }, "version 2");
    expect_error(
        ErrorCode::kUnsupported, [&] { verified_hash(*bytes); }, "version 2");
  }
  expect_error(
      ErrorCode::kUnsupported, [&] { decode_cell(kind); }, "kind 77");
  expect_error(
      ErrorCode::kUnsupported, [&] { decode_cell(lattice_version); }, "version 2");
  expect_error(
      ErrorCode::kUnsupported, [&] { decode_cell(size); }, "999");
}

TEST(CellCodec, EveryRequiredFieldIsRequired) {
  for (const int field : {kLattice, kIndices, kPlanes, kSession, kPose}) {
    const Bytes bytes =
        broken([&](RawBuffer& raw, std::size_t root) { raw.drop_field(root, field); });
    expect_error(
        ErrorCode::kCorruptData, [&] { decode_cell(bytes); }, "field is missing");
  }
  Bytes bytes = encode_cell(random_cell(1, 12)).bytes;
  RawBuffer raw(bytes);
  raw.drop_field(raw.root(), kHash);
  expect_error(
      ErrorCode::kCorruptData, [&] { decode_cell(bytes); }, "field is missing");
  const Bytes unversioned =
      broken([](RawBuffer& raw, std::size_t root) { raw.drop_field(root, kVersion); });
  expect_error(
      ErrorCode::kCorruptData, [&] { decode_cell(unversioned); }, "version");
}

TEST(CellCodec, AbsentStatisticsAreZero) {
  const Bytes bytes =
      broken([](RawBuffer& raw, std::size_t root) { raw.drop_field(root, kStatistics); });
  EXPECT_EQ(decode_cell(bytes).statistics, CellStatistics{});
}

TEST(CellCodec, OtherFilesAreToldApart) {
  Bytes bytes = encode_cell(random_cell(1, 12)).bytes;
  bytes[4] = std::byte{'X'};
  expect_error(
      ErrorCode::kCorruptData, [&] { decode_cell(bytes); }, "found 'XELL'");
  expect_error(
      ErrorCode::kCorruptData, [&] { decode_cell({}); }, "at least 8 bytes");
  const Bytes zeros(1000);
  expect_error(
      ErrorCode::kCorruptData, [&] { decode_cell(zeros); }, "????");
}

TEST(CellCodec, TooLargeIsRefusedBeforeItIsRead) {
  const Bytes bytes(kMaxCellBytes + 1);
  expect_error(ErrorCode::kTooLarge, [&] { decode_cell(bytes); });
}

TEST(CellCodec, TruncationAtAnyLengthIsCorruptData) {
  const Bytes bytes = encode_cell(random_cell(7, 30)).bytes;
  for (std::size_t length = 0; length < bytes.size(); ++length) {
    const Bytes truncated(bytes.begin(), bytes.begin() + length);
    expect_error(ErrorCode::kCorruptData, [&] { decode_cell(truncated); });
  }
}

TEST(CellCodec, TrailingBytesAreCorruptData) {
  Bytes bytes = encode_cell(random_cell(7, 30)).bytes;
  bytes.push_back(std::byte{0});
  expect_error(
      ErrorCode::kCorruptData, [&] { decode_cell(bytes); }, "content hash");
}

TEST(CellCodec, EveryFlippedBitIsDetected) {
  Bytes bytes = encode_cell(random_cell(8, 6)).bytes;
  for (std::size_t at = 0; at < bytes.size(); ++at) {
    for (int bit = 0; bit < 8; ++bit) {
      bytes[at] ^= std::byte{1} << bit;
      const auto thrown = thrown_by([&] { decode_cell(bytes); });
      bytes[at] ^= std::byte{1} << bit;
      ASSERT_TRUE(thrown) << "bit " << bit << " of byte " << at;
      EXPECT_TRUE(thrown->code == ErrorCode::kCorruptData ||
                  thrown->code == ErrorCode::kUnsupported);
    }
  }
}

TEST(CellCodec, ASealedFlipNeverCrashesAndWhatPassesIsValid) {
  // An attacker can compute the hash too: every byte takes hostile values, sealed again.
  const Bytes good = encode_cell(random_cell(8, 6)).bytes;
  int accepted = 0;
  for (std::size_t at = 0; at < good.size(); ++at) {
    for (const int value : {0x00, 0x01, 0x7f, 0x80, 0xff}) {
      Bytes bytes = good;
      bytes[at] = std::byte(value);
      const RawBuffer raw(bytes);
      const std::size_t root = raw.root();
      if (root + 4 <= bytes.size()) {
        const auto vtable = static_cast<std::int64_t>(root) - raw.get<std::int32_t>(root);
        if (vtable < 0 || vtable + 8 > static_cast<std::int64_t>(bytes.size())) continue;
        if (root + raw.get<std::uint16_t>(vtable + 6) + 32 > bytes.size()) continue;
        seal(bytes);
      }
      std::optional<Cell> cell;
      thrown_by([&] { cell = decode_cell(bytes); });
      if (!cell) continue;
      ++accepted;
      EXPECT_NO_THROW(validate(*cell));
    }
  }
  EXPECT_GT(accepted, 0);
}

TEST(CellView, IsTheCellWhereItsBytesLie) {
  const Cell cell = random_cell(9, 40);
  const EncodedCell encoded = encode_cell(cell);
  const CellView view = view_cell(encoded.bytes);
  EXPECT_EQ(view.hash, encoded.hash);
  EXPECT_EQ(view.header.session, cell.session);
  EXPECT_TRUE(view.header.planes.empty());
  expect_equal(view.to_cell(), cell);
  const auto* const begin = encoded.bytes.data();
  for (const auto part : {std::as_bytes(view.indices), std::as_bytes(view.planes)}) {
    EXPECT_GE(part.data(), begin);
    EXPECT_LE(part.data() + part.size(), begin + encoded.bytes.size());
  }
}

TEST(CellView, BytesThatAreNotAlignedMustBeCopiedFirst) {
  Bytes shifted(1);
  const Bytes bytes = encode_cell(random_cell(9, 4)).bytes;
  shifted.insert(shifted.end(), bytes.begin(), bytes.end());
  const auto thrown = thrown_by([&] { view_cell(std::span(shifted).subspan(1)); });
  ASSERT_TRUE(thrown);
  EXPECT_EQ(thrown->code, ErrorCode::kInvalidArgument);
}

TEST(CellCodec, MisalignedInputIsReadAsWell) {
  const Cell cell = random_cell(9, 40);
  const Bytes bytes = encode_cell(cell).bytes;
  for (std::size_t shift = 1; shift < 16; ++shift) {
    Bytes shifted(shift);
    shifted.insert(shifted.end(), bytes.begin(), bytes.end());
    expect_equal(decode_cell(std::span(shifted).subspan(shift)), cell);
  }
}

}  // namespace
}  // namespace cellmap
