#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace cellmap {

/// The scan files of a drive, in driving order.
struct ScanFiles {
  std::filesystem::path folder;              ///< the one that holds the files
  std::string extension;                     ///< of all of them: ".bin", ".pcd" or ".ply"
  std::vector<std::filesystem::path> files;  ///< in driving order
  /// True where the names do not contradict that file i is scan i of a longer recording: they are
  /// numbered 0, 1, 2, ... or not numbered at all.
  bool may_begin_a_longer_drive = false;
};

/// Finds the .bin, .pcd or .ply files of a drive in `folder`/velodyne, `folder`/scans or `folder`
/// itself, the first that holds any. Names with a common beginning and a number at the end are
/// ordered by the number ("scan_2" before "scan_10"), others by name. Other files and hidden files
/// are ignored. Throws Error{kNotFound} where there is no folder or no scan, {kInvalidArgument}
/// where extensions are mixed, two folders hold scans, or a number occurs twice.
ScanFiles find_scan_files(const std::filesystem::path& folder);

}  // namespace cellmap
