#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "cellmap/codec/scan_codec.hpp"

namespace cellmap {

/// Limits of a batch (application/vnd.cellmap.scans; FORMAT.md, "Batch of scans").
constexpr std::size_t kMaxBatchScans = 64;
constexpr std::size_t kMaxScanBatchBytes = 32u << 20;

/// Appends one scan to a batch: its length as little-endian uint32, then `encode_scan`. Throws what
/// that does, and Error{kTooLarge} where the batch would be over its limit in bytes.
void append_to_scan_batch(Bytes& batch, const PosedScan& scan);

/// The scans of a batch, each as `decode_scan` gives it: untrusted input. Throws what that does,
/// Error{kCorruptData} where the batch ends inside an entry, holds no scan, or a scan does not have
/// the index after that of the scan before it; Error{kTooLarge} over a limit.
std::vector<PosedScan> decode_scan_batch(std::span<const std::byte> batch);

}  // namespace cellmap
