#pragma once

#include <span>

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/scan/scan_source.hpp"

namespace cellmap {

/// A scan with stamp and odometry pose on its way to the server (schema/scan.fbs, identifier
/// "CSCN").
Bytes encode_scan(const PosedScan& scan);

/// Verifies and bounds (at most `kMaxScanPoints` points, equal lengths, rigid pose); coordinates
/// may be NaN or infinite, as in a raw sweep, and are dropped later by `filter_scan`.
PosedScan decode_scan(std::span<const std::byte> bytes);

}  // namespace cellmap
