#include "server/jobs/shared_drive.hpp"

#include <algorithm>
#include <thread>
#include <utility>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/core/progress.hpp"
#include "cellmap/pipeline/cut_drive.hpp"

namespace cellmap::server {
namespace {

using Clock = std::chrono::steady_clock;

/// Some tenths of a second of work, so that asking and telling cost little beside it.
constexpr std::size_t kCellsOfAPart = 4;
/// Parts that are offered ahead, and thus what the store holds of a job: 1 MB each.
constexpr std::size_t kAheadOfNobody = 2, kAheadOfAHelper = 4, kMostAhead = 64;
/// Parts that are made here before their turn, with the points of their base scans in memory.
constexpr std::size_t kMostKept = 2;
constexpr std::chrono::milliseconds kLookAgainForPart(5), kLeastPatience(50);

DriveStretch whole(const std::vector<DriveStretch>& cells) {
  DriveStretch all = cells.front();
  all.scan_count = cells.back().first_scan + cells.back().scan_count - all.first_scan;
  return all;
}

[[noreturn]] void not_what_was_asked_for(const char* what) {
  throw Error(ErrorCode::kCorruptData,
              std::string("it is not the part that was asked for: ") + what + " differs");
}

}  // namespace

Bytes pack_part(const std::vector<FinishedCell>& cells) {
  std::vector<MadeCell> made;
  for (const FinishedCell& cell : cells) {
    made.push_back({std::shared_ptr<const Cell>(cell.target, &cell.cell()), cell.scans,
                    cell.raw_points, cell.voxels});
  }
  return zstd_compress(encode_drive_part(made));
}

SharedDrive::SharedDrive(const SharedJob& job, const IngestRequest& request,
                         std::shared_ptr<const Lattice> lattice, ScanSource& source,
                         std::uint64_t first_scan, std::uint32_t first_sequence,
                         std::stop_token stop)
    : job_(job),
      request_(request),
      lattice_(std::move(lattice)),
      source_(source),
      stop_(std::move(stop)) {
  const auto cells =
      cut_drive(source.odometry(), first_scan, first_sequence, request.options.cell_distance_m);
  for (std::size_t i = 0; i < cells.size(); i += kCellsOfAPart) {
    const auto begin = cells.begin() + static_cast<std::ptrdiff_t>(i);
    const std::size_t count = std::min(kCellsOfAPart, cells.size() - i);
    Part& part = parts_.emplace_back();
    part.cells.assign(begin, begin + static_cast<std::ptrdiff_t>(count));
    const DriveStretch all = whole(part.cells);
    part.offer = {job.claim, all.sequence, all.first_scan, all.scan_count};
  }
}

void SharedDrive::make_all(const HandOn& hand_on) {
  for (at_ = 0; at_ < parts_.size(); ++at_) {
    offer_ahead();
    const bool is_wanted = hand_on_part(parts_[at_], [&](FinishedCell&& cell) {
      throw_if_stopped(stop_);
      cell.voxel_points = voxels_.add(cell.voxels);
      return hand_on(std::move(cell));
    });
    if (!is_wanted) return;
  }
}

void SharedDrive::offer_ahead() {
  const std::size_t ahead =
      std::min(kMostAhead, kAheadOfNobody + kAheadOfAHelper * helpers_.size());
  std::vector<JobPart> offers;
  for (; offered_ < std::min(parts_.size(), at_ + 1 + ahead); ++offered_) {
    offers.push_back(parts_[offered_].offer);
  }
  job_.parts.offer_parts(offers);
}

bool SharedDrive::hand_on_part(Part& part, const HandOn& hand_on) {
  std::optional<Cells> made;
  if (auto kept = kept_.extract(part.offer.first_sequence)) {
    made = std::move(kept.mapped());
  } else if (at_ > 0) {
    made = made_by_others(part);
  }
  if (!made) return make_here(part, hand_on);
  return std::ranges::all_of(*made, [&](FinishedCell& cell) { return hand_on(std::move(cell)); });
}

bool SharedDrive::make_here(const Part& part, const HandOn& hand_on) {
  const auto begun = Clock::now();
  const bool is_wanted =
      cellmap::make_part(source_, FrontEnd(request_.options, request_.session, lattice_),
                         whole(part.cells), hand_on, stop_);
  patience_ = Clock::now() - begun;
  job_.log.debug("job {}: made CELLs from {} on here, {} ahead", job_.claim.job.value,
                 part.offer.first_sequence, kept_.size());
  return is_wanted;
}

/// nullopt where it is to be made here; nobody else makes it then, or in vain.
std::optional<SharedDrive::Cells> SharedDrive::made_by_others(const Part& part) {
  std::optional<Clock::time_point> deadline;
  for (;;) {
    throw_if_stopped(stop_);
    const States states = look();
    const auto state = states.find(part.offer.first_sequence);
    if (state == states.end()) return std::nullopt;
    if (state->second.is_made) return collect(part);
    if (state->second.worker.empty()) {
      if (job_.parts.retract_part(part.offer)) return std::nullopt;
      continue;  // somebody took it just now
    }
    if (make_another(states)) continue;
    const auto now = Clock::now();
    if (!deadline) deadline = now + std::max<Clock::duration>(patience_, kLeastPatience);
    if (now >= *deadline) {
      job_.log.info("job {}: CELLs from {} on are made here; {} is slow or gone",
                    job_.claim.job.value, part.offer.first_sequence, state->second.worker);
      return collect(part);
    }
    std::this_thread::sleep_for(kLookAgainForPart);
  }
}

SharedDrive::States SharedDrive::look() {
  States states;
  for (JobPartState& state : job_.parts.offered_parts(job_.claim)) {
    if (!state.worker.empty()) helpers_.insert(state.worker);
    states.emplace(state.first_sequence, std::move(state));
  }
  return states;
}

/// Makes the next part that nobody has taken, for later. False where there is none.
bool SharedDrive::make_another(const States& states) {
  if (kept_.size() >= kMostKept) return false;
  for (std::size_t i = at_ + 1; i < offered_; ++i) {
    const Part& part = parts_[i];
    const auto state = states.find(part.offer.first_sequence);
    if (state == states.end() || !state->second.worker.empty()) continue;
    if (!job_.parts.retract_part(part.offer)) continue;
    Cells cells;
    make_here(part, [&](FinishedCell&& cell) {
      cells.push_back(std::move(cell));
      return true;
    });
    kept_.emplace(part.offer.first_sequence, std::move(cells));
    return true;
  }
  return false;
}

/// What another worker has made; nullopt where it has not, or where it is not good.
std::optional<SharedDrive::Cells> SharedDrive::collect(const Part& part) {
  try {
    const auto bytes = job_.parts.collect_part(part.offer);
    if (!bytes) return std::nullopt;
    job_.log.debug("job {}: collects CELLs from {} on", job_.claim.job.value,
                   part.offer.first_sequence);
    auto made = decode_drive_part(zstd_decompress(*bytes, kMaxDrivePartBytes));
    if (made.size() != part.cells.size()) not_what_was_asked_for("the number of CELLs");
    Cells cells;
    for (std::size_t i = 0; i < made.size(); ++i) {
      cells.push_back(unpack(part.cells[i], std::move(made[i])));
    }
    return cells;
  } catch (const Error& error) {
    const bool is_bad = error.code() == ErrorCode::kCorruptData ||
                        error.code() == ErrorCode::kTooLarge ||
                        error.code() == ErrorCode::kUnsupported;
    if (!is_bad) throw;
    job_.log.error("job {}: CELLs from {} on are made again here: {}", job_.claim.job.value,
                   part.offer.first_sequence, error.what());
    return std::nullopt;
  }
}

FinishedCell SharedDrive::unpack(const DriveStretch& expected, MadeCell&& made) {
  const Cell& cell = *made.cell;
  if (DriveStretch{cell.sequence, cell.first_scan, cell.scan_count} != expected) {
    not_what_was_asked_for("the stretch of a CELL");
  }
  if (cell.session != request_.session) not_what_was_asked_for("the session");
  if (cell.lattice != lattice_->spec()) not_what_was_asked_for("the lattice");
  if (cell.T_odom_cell.matrix() != source_.odometry()[expected.first_scan].matrix()) {
    not_what_was_asked_for("the odometry");
  }
  source_.seek(expected.first_scan);
  const auto base_scan = source_.next();
  if (!base_scan) not_what_was_asked_for("the drive");
  FinishedCell finished;
  finished.points =
      filter_scan(base_scan->points, base_scan->stamp, request_.options.filter).points;
  finished.target = std::make_shared<const RegistrationTarget>(std::move(made.cell), lattice_);
  finished.scans = std::move(made.scans);
  finished.raw_points = made.raw_points;
  finished.voxels = std::move(made.voxels);
  return finished;
}

}  // namespace cellmap::server
