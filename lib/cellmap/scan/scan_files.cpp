#include "cellmap/scan/scan_files.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

constexpr std::array<std::string_view, 3> kExtensions = {".bin", ".pcd", ".ply"};
constexpr std::array<std::string_view, 2> kScanFolders = {"velodyne", "scans"};

std::string lower_extension(const fs::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

/// The scan files right in `folder`, in no order; none where there is no such folder.
std::vector<fs::path> scans_in(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code code;
  if (!fs::is_directory(folder, code)) return files;
  for (fs::directory_iterator i(folder, code), end; !code && i != end; i.increment(code)) {
    const fs::path& file = i->path();
    const bool hidden = file.filename().string().starts_with('.');
    const bool known = std::find(kExtensions.begin(), kExtensions.end(), lower_extension(file)) !=
                       kExtensions.end();
    std::error_code ignored;  // a dangling link is not a regular file
    if (known && !hidden && i->is_regular_file(ignored)) files.push_back(file);
  }
  if (code) throw Error(ErrorCode::kIo, folder.string() + ": cannot be listed: " + code.message());
  return files;
}

ScanFiles find_unordered(const fs::path& folder) {
  ScanFiles found;
  for (const std::string_view name : kScanFolders) {
    std::vector<fs::path> files = scans_in(folder / name);
    if (files.empty()) continue;
    if (!found.files.empty()) {
      throw Error(ErrorCode::kInvalidArgument,
                  folder.string() + ": expected scans in velodyne/ or in scans/, found some in " +
                      "both: name the folder that is meant");
    }
    found.folder = folder / name;
    found.files = std::move(files);
  }
  if (found.files.empty()) {
    found.folder = folder;
    found.files = scans_in(folder);
  }
  if (found.files.empty()) {
    throw Error(ErrorCode::kNotFound,
                folder.string() + ": expected .bin, .pcd or .ply scans here, in velodyne/ or in " +
                    "scans/, found none");
  }
  return found;
}

std::string common_extension(const ScanFiles& scans) {
  std::map<std::string, std::size_t> counts;
  for (const fs::path& file : scans.files) ++counts[lower_extension(file)];
  if (counts.size() == 1) return counts.begin()->first;
  std::string found;
  for (const auto& [extension, count] : counts) {
    found += (found.empty() ? "" : " and ") + std::to_string(count) + " " + extension;
  }
  throw Error(ErrorCode::kInvalidArgument, scans.folder.string() +
                                               ": expected scans of one kind, found " + found +
                                               " files: move those of the other kind away");
}

/// "scan_0012" is {"scan_", 12}.
struct NumberedName {
  std::string prefix;
  std::uint64_t number = 0;
};

std::optional<NumberedName> numbered_name(const fs::path& file) {
  const std::string stem = file.stem().string();
  const std::size_t begin = stem.find_last_not_of("0123456789") + 1;  // npos + 1 is 0
  const std::size_t digits = stem.size() - begin;
  if (digits == 0 || digits > 19) return std::nullopt;  // 19 digits fit: nanoseconds
  return NumberedName{stem.substr(0, begin), std::stoull(stem.substr(begin))};
}

/// The files by number, where all are numbered after the same prefix.
std::optional<std::map<std::uint64_t, fs::path>> by_number(const ScanFiles& scans) {
  std::map<std::uint64_t, fs::path> ordered;
  std::string prefix;
  for (const fs::path& file : scans.files) {
    const std::optional<NumberedName> name = numbered_name(file);
    if (!name) return std::nullopt;
    if (ordered.empty()) prefix = name->prefix;
    if (name->prefix != prefix) return std::nullopt;
    const auto [other, added] = ordered.emplace(name->number, file);
    if (!added) {
      throw Error(ErrorCode::kInvalidArgument,
                  scans.folder.string() + ": expected every scan number once, found " +
                      other->second.filename().string() + " and " + file.filename().string());
    }
  }
  return ordered;
}

}  // namespace

ScanFiles find_scan_files(const fs::path& folder) {
  std::error_code code;
  if (!fs::is_directory(folder, code)) {
    throw Error(ErrorCode::kNotFound,
                folder.string() + ": expected the folder of a recorded drive, found " +
                    (fs::exists(folder, code) ? "a file" : "nothing of that name"));
  }
  ScanFiles scans = find_unordered(folder);
  scans.extension = common_extension(scans);
  std::sort(scans.files.begin(), scans.files.end());
  scans.may_begin_a_longer_drive = true;
  if (const auto ordered = by_number(scans)) {
    scans.files.clear();
    for (const auto& [number, file] : *ordered) scans.files.push_back(file);
    // Distinct numbers: the last one tells whether they are 0 ... n - 1.
    scans.may_begin_a_longer_drive = ordered->rbegin()->first == scans.files.size() - 1;
  }
  return scans;
}

}  // namespace cellmap
