#include "cellmap/codec/released_folder.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <set>
#include <string_view>

#include "cellmap/codec/plane_pcd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/scan/text_table.hpp"

namespace cellmap {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxCells = 1'048'576;
constexpr std::size_t kMostBytesOfAnIndex = 12;  // as text
constexpr double kMaxDistanceM = 10'000;

/// n of cell_<n>.pcd; nullopt for another name.
std::optional<std::size_t> cell_number(std::string_view name) {
  constexpr std::string_view kBegin = "cell_", kEnd = ".pcd";
  if (!name.starts_with(kBegin) || !name.ends_with(kEnd)) return std::nullopt;
  name.remove_prefix(kBegin.size());
  name.remove_suffix(std::min(kEnd.size(), name.size()));
  std::size_t number = 0;
  const auto [end, code] = std::from_chars(name.data(), name.data() + name.size(), number);
  if (code != std::errc{} || end != name.data() + name.size()) return std::nullopt;
  return number;
}

std::size_t count_cells(const fs::path& folder) {
  std::error_code failed;
  fs::directory_iterator entries(folder, failed);
  if (failed) throw Error(ErrorCode::kNotFound, folder.string() + ": no such folder");
  std::set<std::size_t> numbers;
  for (const fs::directory_entry& entry : entries) {
    if (const auto number = cell_number(entry.path().filename().string())) numbers.insert(*number);
    if (numbers.size() > kMaxCells) {
      throw Error(ErrorCode::kTooLarge,
                  folder.string() + ": more than " + std::to_string(kMaxCells) + " CELLs");
    }
  }
  if (numbers.empty()) {
    throw Error(ErrorCode::kNotFound, folder.string() +
                                          ": expected cell_0.pcd, index_0.txt and "
                                          "so on, found no CELL");
  }
  if (*numbers.rbegin() + 1 != numbers.size()) {
    throw Error(ErrorCode::kCorruptData,
                folder.string() + ": " + std::to_string(numbers.size()) +
                    " CELLs are not numbered from 0 on; the last is cell_" +
                    std::to_string(*numbers.rbegin()) + ".pcd");
  }
  return numbers.size();
}

/// All numbers of a text file, which are lattice points.
std::vector<std::uint32_t> read_indices(const fs::path& file, std::size_t max_count) {
  const std::string text = read_file(file, kMostBytesOfAnIndex * max_count);
  std::vector<std::uint32_t> indices;
  const char *at = text.data(), *const end = at + text.size();
  const auto is_blank = [](char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; };
  while ((at = std::find_if_not(at, end, is_blank)) != end) {
    std::uint32_t index = 0;
    const auto [next, code] = std::from_chars(at, end, index);
    if (code != std::errc{} || (next != end && !is_blank(*next)) || index >= max_count ||
        (!indices.empty() && index <= indices.back())) {
      throw Error(ErrorCode::kCorruptData,
                  file.string() + ": number " + std::to_string(indices.size() + 1) +
                      " is no lattice point above the one before and below " +
                      std::to_string(max_count) + "; another --lattice-size?");
    }
    indices.push_back(index);
    at = next;
  }
  return indices;
}

/// The plane with a unit normal that faces the origin; nullopt where a CELL may not have it.
std::optional<Plane> as_cell_has_it(const Plane& plane, const Eigen::Vector3d& direction) {
  Eigen::Vector3d n(plane.nx, plane.ny, plane.nz);
  const double norm = n.norm(), along = n.dot(direction);
  const bool is_plane = std::isfinite(norm) && std::abs(norm - 1) < 0.01 && along != 0 &&
                        plane.distance_m > 0 && plane.distance_m <= kMaxDistanceM;
  if (!is_plane) return std::nullopt;
  n *= (along < 0 ? 1 : -1) / norm;
  const Plane facing = {plane.distance_m, static_cast<float>(n.x()), static_cast<float>(n.y()),
                        static_cast<float>(n.z())};
  const double rounded =
      facing.nx * direction.x() + facing.ny * direction.y() + facing.nz * direction.z();
  return rounded < 0 ? std::optional(facing) : std::nullopt;
}

}  // namespace

void ReleasedFolderOptions::validate() const {
  lattice.validate();
  if (!(cell_distance_m > 0 && cell_distance_m <= 1'000)) {
    throw Error(ErrorCode::kInvalidArgument,
                "the distance of CELLs must be above 0 and at most "
                "1000 m, not " +
                    std::to_string(cell_distance_m));
  }
  if (!is_session_name(session)) {
    throw Error(ErrorCode::kInvalidArgument,
                "a session's name has 1 to 64 characters of A-Z a-z 0-9 . _ -");
  }
}

ReleasedFolder::ReleasedFolder(fs::path folder, const ReleasedFolderOptions& options)
    : folder_(std::move(folder)),
      options_((options.validate(), options)),
      lattice_(options.lattice),
      size_(count_cells(folder_)) {
  poses_ = read_trajectory(options_.poses.empty() ? folder_ / "cell_odom.txt" : options_.poses);
  find_bases(size_);
}

/// The released code begins a CELL with the first scan that is farther away than the gap from the
/// base before, and writes a CELL when the next begins, so that the last is never written. A file
/// of as many poses as CELLs says itself where each begins.
void ReleasedFolder::find_bases(std::size_t cells) {
  std::vector<std::size_t> bases;
  for (std::size_t i = 0; i < poses_.size(); ++i) {
    const auto away = [&] {
      return (poses_[i].pose.translation() - poses_[bases.back()].pose.translation()).norm();
    };
    if (bases.empty() || poses_.size() == cells || away() > options_.cell_distance_m) {
      bases.push_back(i);
    }
  }
  if (bases.size() != cells && bases.size() != cells + 1) {
    throw Error(ErrorCode::kCorruptData,
                folder_.string() + ": " + std::to_string(cells) + " CELLs, but its " +
                    std::to_string(poses_.size()) + " poses make " + std::to_string(bases.size()) +
                    " (the last of which is not written) at more than " +
                    std::to_string(options_.cell_distance_m) +
                    " m from one to the next; give the distance (base_gap) they were made with");
  }
  bases_ = std::move(bases);
  if (bases_.size() == cells) bases_.push_back(poses_.size());
}

ReleasedCell ReleasedFolder::read(std::size_t k) const {
  const std::string number = std::to_string(k);
  const auto planes = read_plane_pcd(folder_ / ("cell_" + number + ".pcd"), lattice_.size());
  const fs::path index_file = folder_ / ("index_" + number + ".txt");
  const auto indices = read_indices(index_file, lattice_.size());
  if (indices.size() != planes.size()) {
    throw Error(ErrorCode::kCorruptData,
                index_file.string() + ": " + std::to_string(indices.size()) +
                    " lattice points for " + std::to_string(planes.size()) + " planes");
  }
  ReleasedCell result;
  Cell& cell = result.cell;
  cell.lattice = options_.lattice;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const auto plane = as_cell_has_it(planes[i], lattice_.direction(indices[i]));
    if (!plane) {
      ++result.dropped;
      continue;
    }
    cell.indices.push_back(indices[i]);
    cell.planes.push_back(*plane);
  }
  const std::size_t first = bases_[k], end = bases_[k + 1];
  cell.session = options_.session;
  cell.sequence = static_cast<std::uint32_t>(k);
  cell.T_odom_cell = poses_[first].pose;
  cell.first_stamp = poses_[first].stamp;
  cell.last_stamp = poses_[end - 1].stamp;
  cell.first_scan = static_cast<std::uint32_t>(first);
  cell.scan_count = static_cast<std::uint32_t>(end - first);
  for (std::size_t i = first; i < end; ++i) {
    result.scans.push_back({poses_[i].stamp, cell.T_odom_cell.inverse() * poses_[i].pose});
  }
  validate(cell);
  return result;
}

}  // namespace cellmap
