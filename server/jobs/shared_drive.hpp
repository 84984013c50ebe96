#pragma once

#include <spdlog/logger.h>

#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <vector>

#include "cellmap/codec/drive_part_codec.hpp"
#include "cellmap/pipeline/make_cells.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "cellmap/store/parts.hpp"
#include "server/jobs/ingest_request.hpp"

namespace cellmap::server {

/// A job of which other workers may make parts.
struct SharedJob {
  Parts& parts;
  JobClaim claim;
  spdlog::logger& log;
};

/// The CELLs of a part as the store takes them. Throws Error{kTooLarge} where they are too many
/// bytes.
Bytes pack_part(const std::vector<FinishedCell>& cells);

/// The CELLs of a recorded drive whose odometry is known before its scans are read, made with the
/// help of other workers. The drive is cut into parts of some CELLs. The next few are offered in
/// the store, more the more workers there are; what was made is collected in order, and the rest is
/// made here. While somebody else makes the part that comes next, another one is made here; when
/// there is none, that part is waited for as long as making one takes here, and then made here too.
/// So a helper that dies or is slow costs no more than that, and the CELLs are those of one worker
/// alone, byte by byte. One owner.
class SharedDrive {
 public:
  /// From scan `first_scan` on, with CELLs from `first_sequence` on. `source` and `request` must
  /// outlive it.
  SharedDrive(const SharedJob& job, const IngestRequest& request,
              std::shared_ptr<const Lattice> lattice, ScanSource& source, std::uint64_t first_scan,
              std::uint32_t first_sequence, std::stop_token stop);

  /// A `CellFeed`. Throws what the source, the store and `hand_on` throw, and Error{kCancelled}.
  void make_all(const HandOn& hand_on);

 private:
  struct Part {
    JobPart offer;
    std::vector<DriveStretch> cells;
  };
  using Cells = std::vector<FinishedCell>;
  using States = std::map<std::uint32_t, JobPartState>;

  void offer_ahead();
  bool hand_on_part(Part& part, const HandOn& hand_on);
  bool make_here(const Part& part, const HandOn& hand_on);
  std::optional<Cells> made_by_others(const Part& part);
  std::optional<Cells> collect(const Part& part);
  bool make_another(const States& states);
  States look();
  FinishedCell unpack(const DriveStretch& expected, MadeCell&& made);

  SharedJob job_;
  const IngestRequest& request_;
  std::shared_ptr<const Lattice> lattice_;
  ScanSource& source_;
  std::stop_token stop_;
  std::vector<Part> parts_;
  std::size_t at_ = 0;                   ///< the part that is handed on
  std::size_t offered_ = 1;              ///< parts before this one have been offered, or begun here
  std::map<std::uint32_t, Cells> kept_;  ///< made here before their turn, by sequence
  std::set<std::string> helpers_;        ///< who has taken a part so far
  std::chrono::steady_clock::duration patience_{};  ///< what the last part took here
  SessionVoxels voxels_;
};

}  // namespace cellmap::server
