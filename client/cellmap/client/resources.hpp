#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/cell/build_cell.hpp"
#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/core/id.hpp"
#include "cellmap/core/stamp.hpp"
#include "cellmap/geometry/pose.hpp"
#include "cellmap/place/loop_detection.hpp"
#include "cellmap/place/relocalise.hpp"
#include "cellmap/pose_graph/edit.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "cellmap/store/store.hpp"

/// What the server's answers become. Where the library has a type it is that one: `MapInfo`,
/// `CellRecord`, `CellQuery`, `CellPage`, `PoseGraph`, `Constraint`, `RelocalisationAnswer`.
namespace cellmap {

/// A CELL as the server handed it out, its bytes verified against its hash.
struct FetchedCell {
  CellId id;
  EncodedCell encoded;                 ///< decode with `decode_cell(encoded.bytes)`
  Pose T_map_cell = Pose::Identity();  ///< where it lies now
  Revision revision = 0;               ///< of the map, when that was so
  bool from_cache = false;  ///< the server confirmed the ETag (304); no CELL bytes were sent
};

/// Several CELLs of one answer.
struct CellBatch {
  Revision revision = 0;
  std::map<CellId, EncodedCell> cells;
  std::uint64_t remaining = 0;  ///< CELLs that the limit cut off; ask again for the rest
};

/// What `Client::put_cell` did.
struct PutCellResult {
  CellRecord cell;
  Revision revision = 0;
  bool created = false;  ///< false: the same CELL was there already
};

/// A drive in a map, and where it stands.
struct Session : SessionInfo {
  std::optional<CellId> last_cell;
  std::optional<Pose> T_map_odom;  ///< at its last CELL; not set while it is not aligned
};

/// What `Client::put_session_cell` did.
struct SessionCell : PutCellResult {
  bool aligned = false;  ///< the session is in the map frame
};

/// What happened to a map after a revision.
struct Changes : MapChanges {
  /// When the map was made, to the millisecond: tells a map from a later one of the same name.
  /// Empty from a server that does not say so.
  std::optional<Stamp> map_created;
};

/// A map has a revision, as its stream of events says.
struct RevisionEvent {
  Revision revision = 0;
  Stamp map_created = 0;  ///< to the millisecond
};

/// What a client has sent and received: bodies as they were on the wire, without heads.
struct Traffic {
  std::uint64_t requests = 0;
  std::uint64_t sent_bytes = 0;
  std::uint64_t received_bytes = 0;
};

/// Which poses of a drive: as the odometry gave them or after the back end.
enum class TrajectoryStage { kOdometry, kCorrected };

/// An answer to "where am I?" with what it took. `answer.found` is empty for an honest "not found".
struct Relocalisation {
  RelocalisationAnswer answer;
  std::optional<ContentHash> cell_hash;  ///< of the CELL that `found` was registered to
  std::optional<GeoPose> geopose;        ///< of `found`; where the map has a georeference
  Revision revision = 0;
  double time_ms = 0;  ///< spent in the server
};

/// The loop constraints of a map.
struct LoopList {
  Revision revision = 0;
  std::vector<Constraint> loops;
};

/// What adding, detecting or removing loops did to a map.
struct LoopReport {
  Revision revision = 0;
  std::vector<Constraint>
      loops;                ///< the new ones; empty where nothing was found or one was removed
  std::uint64_t moved = 0;  ///< CELLs whose pose changed
  double initial_cost = 0, final_cost = 0;  ///< of the pose graph, before and after
};

/// A long-running operation of the server.
struct Job {
  JobId id;
  std::string map, kind, session;
  JobState state = JobState::kQueued;
  std::uint64_t scans_done = 0, scans_total = 0, cells_done = 0;
  std::optional<double> progress;  ///< 0 to 1, where the total is known
  double scans_per_second = 0;
  std::optional<double> eta_s;
  std::optional<std::uint64_t> next_scan;  ///< of an upload that runs: the index expected next
  std::string worker;    ///< which process carries it out; empty: none, or the server is older
  Stamp lease_ends = 0;  ///< Unix time; then another one may take it over
  std::optional<ErrorCode> error_code;
  std::string error_message;       ///< of a failed job
  Stamp created = 0, updated = 0;  ///< Unix time
};

/// How the server is to map a drive; what is not set is the server's default. Meanings, units and
/// ranges are those of `MapperOptions`, `ScanFilterOptions` and `CellBuildOptions`.
struct IngestOptions {
  std::optional<double> cell_distance_m, min_range_m, max_range_m, vertical_angle_correction_deg;
  std::optional<bool> bidirectional, loop_closures;
  std::optional<LoopAcceptance> loop_acceptance;
  std::optional<std::uint32_t> min_points;
  std::optional<double> max_range_gap_m;
  std::optional<PlaneFit> fit;
};

/// Asks for an ingest job. Posting the same session again resumes it.
struct IngestRequest {
  /// 1 to 64 characters [A-Za-z0-9._-]; empty: the name of the folder at `path` (uploads need one).
  std::string session;
  std::string path;   ///< of the drive on the server, under one of its data roots; empty: upload
  std::string poses;  ///< with `path`: a trajectory file on the server; empty: the drive's own
  PoseFrame pose_frame = PoseFrame::kAuto;
  std::uint64_t scans_total = 0;  ///< of an upload, for its progress; 0: not known
  IngestOptions options;
  bool create_map = true;              ///< makes the map where it is missing ...
  std::optional<LatticeSpec> lattice;  ///< ... with this lattice (default: the server's)
  /// In which the CELLs of this drive are kept, and of a map that is made; else in the map's.
  std::optional<CellForm> form;
};

/// How the server took a scan of an upload.
struct PutScanResult {
  bool accepted = true;
  std::uint64_t next_scan = 0;  ///< where not accepted: the index that it waits for
};

/// How far the server is with the scans of a drive.
struct SessionScans {
  enum class State {
    kNew,        ///< nothing is there
    kMapping,    ///< a job takes scans
    kFinishing,  ///< the drive has ended, a job works on its last scans
    kPaused,     ///< no scan came for long; the next makes a job
    kStopped,    ///< its job was cancelled or failed: `Client::start_ingest` goes on
    kEnded,      ///< the drive is in the map
  };
  State state = State::kNew;
  std::optional<std::uint64_t> next_scan;  ///< not set where a job reads a path
  std::uint64_t keep_from = 0;             ///< no scan before this one is asked for again
  std::uint64_t room = 0;                  ///< scans that would be taken now without waiting
  std::uint64_t taken = 0;                 ///< scans of this request that were new
  std::optional<Job> job;                  ///< the unfinished one, else the last
};

}  // namespace cellmap
