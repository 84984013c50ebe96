#include "cellmap/client/pull.hpp"

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "cellmap/client/coded_cells.hpp"
#include "cellmap/client/files.hpp"
#include "cellmap/client/puller.hpp"

namespace cellmap {
namespace fs = std::filesystem;
using client::make_directory;
using client::Puller;

namespace client {
namespace {

/// The folder, made where it is missing: nothing can be locked in one that is not there.
fs::path made(fs::path folder) {
  make_directory(folder / "cells");
  return folder;
}

Mirror fresh(Client& client, const MapInfo& info) {
  return {to_string(client.url()), info.name, info.created, info, {}, 0, {}, {}};
}

/// True where the folder has the CELL at least as exactly as `form`. `trusted`: files of that form
/// are not read.
bool is_here(const fs::path& folder, const CellRecord& record, const CellForm& form,
             const CellForm& trusted_form, bool trusted) {
  const auto file = find_mirrored_cell(folder, record.hash);
  if (!file) return false;
  const bool is_whole = *file == mirror_cell_file(folder, record.hash);
  if (trusted && (is_whole || form == trusted_form)) return true;
  try {
    const auto kept = read_mirrored_kept_cell(folder, record.hash);
    return kept && (kept->encoded.hash == record.hash || kept->coded->form.is_within(form));
  } catch (const Error&) {
    return false;  // damaged: fetched again
  }
}

/// What a CELL takes in the folder; of one that is not here no more than this.
std::uint64_t bytes_of(const fs::path& folder, const CellRecord& record, const CellForm& form) {
  if (const auto file = find_mirrored_cell(folder, record.hash)) return fs::file_size(*file);
  constexpr std::uint64_t kCompactShare = 4;  // of the raw bytes, at a bound of 1 mm
  return form.is_exact() ? record.encoded_bytes : record.encoded_bytes / kCompactShare;
}

/// Which CELLs the folder is to hold, and which of these it lacks.
struct Selection {
  std::vector<CellRecord> wanted, missing;
};

double distance(const CellRecord& cell, const PullOptions& options) {
  return (cell.T_map_cell.translation() - *options.near).norm();
}

/// CELLs nearest first where a place is given, else in order of id.
std::vector<CellRecord> in_order(const Mirror& mirror, const PullOptions& options) {
  std::vector<CellRecord> cells;
  for (const auto& [id, record] : mirror.cells) cells.push_back(record);
  if (options.near) {
    std::stable_sort(cells.begin(), cells.end(), [&](const CellRecord& a, const CellRecord& b) {
      return distance(a, options) < distance(b, options);
    });
  }
  return cells;
}

/// Files of CELLs that the mirror had before are trusted by name; those of CELLs that are new to it
/// are read, because a pull that was broken off may have left them.
Selection select(const Mirror& mirror, Revision before, const CellForm& form,
                 const fs::path& folder, const PullOptions& options) {
  Selection selection;
  std::uint64_t bytes = 0;
  for (CellRecord& cell : in_order(mirror, options)) {
    const bool trusted = cell.added <= before;
    const bool here = is_here(folder, cell, form, mirror.form, trusted);
    const bool near =
        !options.near || (cell.T_map_cell.translation() - *options.near).norm() <= options.radius_m;
    if (!here && !near) continue;
    bytes += bytes_of(folder, cell, form);
    if (options.budget_bytes > 0 && bytes > options.budget_bytes) break;  // all others are further
    if (!here) selection.missing.push_back(cell);
    selection.wanted.push_back(std::move(cell));
  }
  return selection;
}

bool is_cell(const fs::path& file) {
  return file.extension() == ".cell" || file.extension() == ".ccod";
}

/// Removes files that the new state does not name; returns how many of them were CELLs.
std::uint64_t remove_leftovers(const Mirror& mirror, const Selection& selection,
                               const fs::path& folder) {
  std::set<fs::path> wanted;
  for (const CellRecord& cell : selection.wanted) {
    if (const auto file = find_mirrored_cell(folder, cell.hash)) wanted.insert(file->filename());
  }
  wanted.insert("pose-graph-" + std::to_string(mirror.revision) + ".cpgr");
  std::uint64_t cells = 0;
  for (const fs::path& place : {folder, folder / "cells"}) {
    std::vector<fs::path> leftovers;
    for (const auto& entry : fs::directory_iterator(place)) {
      const std::string extension = entry.path().extension().string();
      // ".tmp...": of a process that died while it wrote.
      const bool ours =
          is_cell(entry.path()) || extension == ".cpgr" || extension.starts_with(".tmp");
      if (ours && !wanted.contains(entry.path().filename())) leftovers.push_back(entry.path());
    }
    for (const fs::path& leftover : leftovers) {
      cells += is_cell(leftover);
      fs::remove(leftover);
    }
  }
  return cells;
}

}  // namespace

bool is_same_creation(Stamp a, Stamp b) {
  constexpr Stamp kMillisecond = 1'000'000;
  return a / kMillisecond == b / kMillisecond;
}

Puller::Puller(Client& client, std::string map, fs::path folder)
    : client_(client), map_(std::move(map)), folder_(made(std::move(folder))), lock_(folder_) {
  mirror_ = find_mirror(folder_);
  const std::string server = to_string(client_.url());
  if (mirror_ && (mirror_->map != map_ || mirror_->server != server)) {
    throw Error(ErrorCode::kConflict,
                "'" + folder_.string() + "' mirrors map '" + mirror_->map + "' of " +
                    mirror_->server + "; give another folder for map '" + map_ + "' of " + server);
  }
}

/// Changes that fit `mirror`, which is emptied where the server's map is another one.
Changes Puller::next_changes(Mirror& mirror, PullReport& report, std::optional<Changes> given) {
  try {
    const bool fits = given && given->since == mirror.revision;
    Changes changes = fits ? *std::move(given) : client_.changes(map_, mirror.revision);
    const Stamp created = changes.map_created ? *changes.map_created : client_.map(map_).created;
    if (is_same_creation(created, mirror.map_created)) return changes;
  } catch (const Error& error) {
    // The map is gone, which `map` says below, or has not come so far again.
    if (error.code() != ErrorCode::kNotFound) throw;
  }
  mirror = fresh(client_, client_.map(map_));
  report.started_over = true;
  return client_.changes(map_, 0);
}

/// The map is asked only where there are CELLs to fetch: updates of poses stay small.
CellForm Puller::form_of(const PullOptions& options, const Mirror& next, const Changes& changes) {
  if (options.form) return *options.form;
  const bool is_first = !mirror_ || mirror_->map_created != next.map_created;
  if (!is_first && changes.added.empty()) return next.form;
  const CellForm kept = is_first ? next.info.form : client_.map(map_).form;
  return kept.is_exact() ? next.form : kept;
}

void Puller::fetch(const std::vector<CellRecord>& missing, const CellForm& form,
                   const PullOptions& options, PullReport& report) {
  const auto keep = [&](const CellRecord& record, const Bytes& bytes) {
    write_file_atomically(mirror_cell_file(folder_, record.hash, form), bytes);
    ++report.fetched;
    report.fetched_bytes += bytes.size();
    if (options.on_cell) options.on_cell(report.fetched, missing.size());
  };
  if (form.encoding == KeptEncoding::kRaw) {
    return client_.for_each_cell(map_, missing,
                                 [&](const auto& record, const auto& c) { keep(record, c.bytes); });
  }
  CodedCellReader reader(client_.options());
  reader.for_each_cell(map_, missing, coded_form_of(form),
                       [&](const auto& record, const auto& cell) { keep(record, cell.bytes); });
  report.received_bytes += reader.traffic().received_bytes;
}

PullReport Puller::pull(const PullOptions& options, std::optional<Changes> given) {
  PullReport report;
  const std::uint64_t received = client_.traffic().received_bytes;
  Mirror next = mirror_ ? *mirror_ : fresh(client_, client_.map(map_));
  const Changes changes = next_changes(next, report, std::move(given));
  report.from = next.revision;
  apply_changes(changes, next);

  const CellForm form = form_of(options, next, changes);
  const Selection selection = select(next, report.from, form, folder_, options);
  fetch(selection.missing, form, options, report);
  const bool is_other_form = next.form != form;
  next.form = form;
  if (!mirror_ || report.started_over || is_other_form || next.revision != mirror_->revision) {
    write_mirror(next, folder_);
  }
  mirror_ = std::move(next);
  report.evicted = remove_leftovers(*mirror_, selection, folder_);
  report.to = mirror_->revision;
  report.cells = mirror_->cells.size();
  report.held = selection.wanted.size();
  report.moved = changes.moved.size();
  report.removed = changes.removed.size();
  report.received_bytes += client_.traffic().received_bytes - received;
  return report;
}

}  // namespace client

void PullOptions::validate() const {
  if (form) form->validate();
  if (near && !(near->allFinite() && std::isfinite(radius_m) && radius_m > 0)) {
    throw Error(ErrorCode::kInvalidArgument,
                "a place to be near needs three finite numbers and a radius above 0 m");
  }
  if (!near && (radius_m != 0 || budget_bytes != 0)) {
    throw Error(ErrorCode::kInvalidArgument,
                "a radius and a budget need a place to be near: which CELLs to keep goes by their "
                "distance");
  }
}

PullReport pull_map(Client& client, const std::string& map, const fs::path& folder,
                    const PullOptions& options) {
  options.validate();
  return Puller(client, map, folder).pull(options);
}

PullReport pull_map(Client& client, const std::string& map, const fs::path& folder,
                    const std::function<void(std::size_t, std::size_t)>& on_cell) {
  PullOptions options;
  options.on_cell = on_cell;
  return pull_map(client, map, folder, options);
}

}  // namespace cellmap
