#include "cellmap/codec/scan_batch.hpp"

#include <string>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kBatchHeaderBytes = 4;

void check_limit(const char* what, std::size_t found, std::size_t limit) {
  if (found <= limit) return;
  throw Error(ErrorCode::kTooLarge, "the number of " + std::string(what) +
                                        " in a batch of scans is at most " + std::to_string(limit) +
                                        ", but " + std::to_string(found) + " were found");
}

void check_rest(const char* where, std::size_t entry, std::size_t expected, std::size_t found) {
  if (found >= expected) return;
  throw Error(ErrorCode::kCorruptData, "the batch of scans ends inside the " + std::string(where) +
                                           " of its entry " + std::to_string(entry) +
                                           ": expected " + std::to_string(expected) +
                                           " bytes, found " + std::to_string(found));
}

std::size_t read_length(std::span<const std::byte> bytes) {
  std::size_t value = 0;
  for (int i = 3; i >= 0; --i) value = value << 8 | std::to_integer<std::size_t>(bytes[i]);
  return value;
}

}  // namespace

void append_to_scan_batch(Bytes& batch, const PosedScan& scan) {
  const Bytes bytes = encode_scan(scan);
  check_limit("bytes", batch.size() + kBatchHeaderBytes + bytes.size(), kMaxScanBatchBytes);
  for (int shift = 0; shift < 32; shift += 8) {
    batch.push_back(static_cast<std::byte>(bytes.size() >> shift));
  }
  batch.insert(batch.end(), bytes.begin(), bytes.end());
}

std::vector<PosedScan> decode_scan_batch(std::span<const std::byte> batch) {
  check_limit("bytes", batch.size(), kMaxScanBatchBytes);
  if (batch.empty()) throw Error(ErrorCode::kCorruptData, "the batch of scans holds no scan");
  std::vector<PosedScan> scans;
  while (!batch.empty()) {
    check_limit("scans", scans.size() + 1, kMaxBatchScans);
    check_rest("length", scans.size(), kBatchHeaderBytes, batch.size());
    const std::size_t length = read_length(batch);
    batch = batch.subspan(kBatchHeaderBytes);
    check_rest("scan", scans.size(), length, batch.size());
    PosedScan scan = decode_scan(batch.first(length));
    if (!scans.empty() && scan.index != scans.back().index + 1) {
      throw Error(ErrorCode::kCorruptData,
                  "the scans of a batch follow one another: expected index " +
                      std::to_string(scans.back().index + 1) + " after " +
                      std::to_string(scans.back().index) + ", found " + std::to_string(scan.index));
    }
    scans.push_back(std::move(scan));
    batch = batch.subspan(length);
  }
  return scans;
}

}  // namespace cellmap
