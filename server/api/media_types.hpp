#pragma once

namespace cellmap::server {

// What bodies of requests and answers are, beside JSON (FORMAT.md says what they hold).
inline constexpr const char* kCellType = "application/vnd.cellmap.cell";
inline constexpr const char* kScanType = "application/vnd.cellmap.scan";
inline constexpr const char* kScansType = "application/vnd.cellmap.scans";

}  // namespace cellmap::server
