#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "cellmap/cell/cell.hpp"
#include "cellmap/cell/local_map.hpp"
#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/kept_cell.hpp"
#include "cellmap/core/hash.hpp"
#include "cellmap/core/id.hpp"
#include "cellmap/map/georeference.hpp"
#include "cellmap/pipeline/back_end.hpp"
#include "cellmap/pipeline/refine.hpp"
#include "cellmap/pose_graph/map_changes.hpp"
#include "cellmap/pose_graph/pose_graph.hpp"
#include "cellmap/store/commit_signal.hpp"

namespace cellmap {

/// Which state of which map. A map that was deleted and made anew has another `created`.
struct MapVersion {
  Stamp created = 0;  ///< Unix time
  Revision revision = 0;
  bool operator==(const MapVersion&) const = default;
};

/// What a store keeps of one map beside its CELLs and pose graph.
struct MapInfo {
  std::string name;
  LatticeSpec lattice;
  Revision revision = 0;
  Stamp created = 0;  ///< Unix time
  std::uint64_t cells = 0;
  std::uint64_t planes = 0;
  std::uint64_t constraints = 0;
  std::uint64_t encoded_bytes = 0;  ///< of all CELLs, as FlatBuffers
  std::uint64_t stored_bytes = 0;   ///< of all CELLs, as kept
  std::uint64_t scans = 0;
  std::uint64_t raw_points = 0;  ///< points of all scans before filtering
  std::uint64_t voxel_points =
      0;  ///< size of the 0.4 m voxel-downsampled map, where it was counted
  /// Bounding box of the CELLs' current positions, map frame; empty() for an empty map.
  Eigen::AlignedBox3d bounds;
  std::vector<std::string> sessions;
  std::optional<Georeference> georeference;
  CellForm form;                           ///< in which CELLs that come from now on are to be kept
  std::map<CellForm, std::uint64_t> kept;  ///< how many CELLs are kept in which form
};

/// One drive of one robot into a map.
struct SessionInfo {
  std::string name;            ///< 1 to 64 characters [A-Za-z0-9._-], unique in the map
  std::string robot;           ///< who drove; up to 64 printable characters, as are the next two
  std::string sensor;          ///< for example "OS1-64"
  std::string odometry_frame;  ///< for example "robot7/odom"
  Stamp started = 0;           ///< Unix time; 0: not said
  bool aligned = true;         ///< its poses are in the map frame; kept by `MapUpdate`
  std::uint64_t cells = 0;     ///< counted by the store, as are the next two
  std::uint64_t planes = 0;
  std::uint64_t encoded_bytes = 0;
};

/// Which CELLs, by their current poses. Conditions add up; borders belong to the area.
struct CellQuery {
  /// With `radius_m` > 0; nearest first, by id where equally far. At most 1e7 m from the origin.
  std::optional<Eigen::Vector3d> near;
  double radius_m = 0;
  std::optional<Eigen::AlignedBox3d> box;
  /// Without one, a search by place finds aligned sessions only: the poses of the others are in
  /// other frames.
  std::optional<std::string> session;
  Revision since = 0;        ///< only CELLs added or moved after this revision
  std::size_t limit = 1000;  ///< 1 to 10,000
  /// `next_cursor` of the page before, of the same query on the same map (the limit may differ);
  /// else Error{kInvalidArgument}. The next page begins behind the last CELL of the page before in
  /// the order of the answer, in the state of the map at that time: a CELL that moved between two
  /// pages of a search by `near` may come twice or not at all (compare CellPage::revision).
  std::string cursor;
};

struct CellPage {
  Revision revision = 0;          ///< the page's snapshot
  std::vector<CellRecord> cells;  ///< ascending id, or nearest first with `near`
  std::string next_cursor;        ///< empty on the last page
};

/// The bytes of a CELL as a store keeps them.
struct StoredCell {
  ContentHash hash;  ///< CellRecord::hash
  CellForm form;
  std::shared_ptr<const Bytes> frame;  ///< one zstd frame: of the encoded CELL, or of a coded one
};

/// What is known of the kept bytes of a CELL without reading them.
struct CellKeeping {
  CellId id;
  ContentHash hash;    ///< CellRecord::hash
  ContentHash source;  ///< CodedCopy::source; where raw, `hash`
  CellForm form;
};

/// A CELL to be stored.
struct NewCell {
  CellId id;
  std::shared_ptr<const Cell> cell;
  EncodedCell encoded;  ///< encode_cell(*cell)
  /// What is kept in place of `encoded`; its bytes decode to `cell` (`keep_cell`).
  std::optional<CodedCopy> coded = {};
  Pose T_map_cell = Pose::Identity();
  bool unaligned = false;  ///< its session, where this CELL makes it, is not in the map frame
  std::vector<ScanInCell> scans;  ///< its stretch of the trajectory; may be empty
  std::uint64_t raw_points = 0;
  std::uint64_t voxel_points = 0;  ///< 0.4 m voxels that the drive hit here first
};

/// Other bytes for a CELL that is there.
struct RecodedCell {
  ContentHash from;     ///< CellRecord::hash now; else Error{kPreconditionFailed}
  EncodedCell encoded;  ///< as in NewCell, as is the next one
  std::optional<CodedCopy> coded = {};
};

/// Any change to a map: one transaction, one new revision. Carried out in the order of the fields,
/// except that what is removed goes first. Bounded (store/validation.hpp):
/// 10,000 CELLs, a million constraints, coordinates within 1e7 m, else Error{kInvalidArgument} or
/// {kTooLarge}.
struct MapUpdate {
  std::vector<NewCell> cells;
  /// A CELL whose hash becomes another one is told as `added` anew; its pose stays, and so do
  /// revisions before this one, with the new bytes.
  std::map<CellId, RecodedCell> recoded;
  std::map<CellId, Pose> poses;  ///< of CELLs that moved; equal poses change nothing
  std::set<CellId> aligned;      ///< their sessions join the map frame
  /// Unnumbered; the store numbers them in this order, from 1. One that is there already, equal in
  /// CELLs, kind, origin, pose and information, is not added again but answered with its id, so
  /// that an update whose answer was lost can be sent again.
  std::vector<Constraint> add_constraints;
  std::vector<ConstraintId> remove_constraints;
  std::map<ConstraintId, Judgement> judged;  ///< of constraints that are there
  /// With their CELLs and all constraints of those, which are forgotten: revisions before this one
  /// can no longer be read. Ids are not given again.
  std::set<std::string> remove_sessions;
  /// Where set and not the map's revision: Error{kPreconditionFailed}, nothing changes.
  std::optional<Revision> expected_revision;
};

/// The update that commits what the pipeline made of one CELL. `kept`: its bytes, where it was
/// brought into a form before (`kept->cell` is `update.cell`); else it is kept raw.
MapUpdate to_map_update(CellUpdate update, std::optional<KeptCell> kept = {});

struct CommitResult {
  Revision revision = 0;                     ///< unchanged where the update changed nothing
  std::vector<ConstraintId> constraint_ids;  ///< of add_constraints, in order
};

enum class JobState : std::uint8_t { kQueued = 1, kRunning, kSucceeded, kFailed, kCancelled };
std::string_view to_string(JobState state);
/// Inverse of `to_string`; Error{kCorruptData} for anything else.
JobState job_state_from_string(std::string_view name);
constexpr bool is_final(JobState state) { return state >= JobState::kSucceeded; }

/// A CELL and the revision of its map, of one state of the store.
struct CurrentCell {
  Revision revision = 0;
  CellRecord record;
  std::optional<StoredCell> stored = {};  ///< of the same state, where its bytes are in memory
};

/// A long-running operation, as kept across restarts.
struct JobRecord {
  JobId id;  ///< numbered by the store
  std::string map;
  std::string kind;          ///< "ingest"
  std::string request_json;  ///< what was asked, as the API received it
  JobState state = JobState::kQueued;
  std::uint64_t scans_done = 0, scans_total = 0, cells_done = 0;
  std::string error_code;  ///< of a failed job, else empty
  std::string error_message;
  Stamp created = 0, started = 0, updated = 0;  ///< Unix time; 0: not yet
};

/// Keeps maps. Every engine passes the same contract tests (tests/store/store_contract.hpp).
///
/// Durability: when a call that changes something returns, the change survives a crash of the
/// process and, as far as the disk keeps its word, of the machine. A change is visible wholly or
/// not at all. Concurrency: any thread may call anything; a read sees one revision, and no writer
/// blocks a reader. Errors: kNotFound (map, CELL, job, constraint, revision), kAlreadyExists,
/// kConflict, kPreconditionFailed, kCorruptData (the store's own bytes are damaged), kIo,
/// kUnavailable (busy).
class Store {
 public:
  virtual ~Store() = default;

  /// Map names: 1 to 64 characters [a-z0-9_-], starting with a letter or digit
  /// (`validate_map_name`). Error{kAlreadyExists} where the name is taken, {kUnsupported} for an
  /// unknown lattice.
  virtual MapInfo create_map(const std::string& name, const LatticeSpec& lattice,
                             const CellForm& form = {}) = 0;
  /// Also its history and the bytes that no other map uses; jobs stay.
  virtual void delete_map(const std::string& name) = 0;
  /// No part of a revision, since no pose in the map depends on it; nullopt takes it away.
  /// Error{kInvalidArgument} out of range.
  virtual void set_georeference(const std::string& map,
                                const std::optional<Georeference>& georeference) = 0;
  /// `MapInfo::form`: who adds CELLs brings them into it (`keep_cell`). No part of a revision;
  /// what is kept stays as it is (`convert_cells`).
  virtual void set_form(const std::string& map, const CellForm& form) = 0;
  virtual std::vector<MapInfo> maps() const = 0;  ///< by name
  virtual MapInfo map(const std::string& name) const = 0;
  /// The little of `map` that tells whether anything has changed: reads one row.
  virtual MapVersion version(const std::string& name) const = 0;

  /// Applies an update. A CELL that is there already with the same id and hash is left alone, its
  /// pose too; with another hash, or its (session, sequence) under another id: Error{kConflict}. A
  /// lattice other than the map's: Error{kInvalidArgument}. A CELL or constraint that is not there:
  /// Error{kNotFound}. The encoded bytes are not looked into: who takes them from outside verifies
  /// them before.
  virtual CommitResult commit(const std::string& map, const MapUpdate& update) = 0;

  virtual CellPage cells(const std::string& map, const CellQuery& query) const = 0;
  virtual CellRecord cell(const std::string& map, CellId id) const = 0;
  /// With its revision. One wait for a database that is far away; a microsecond for a CELL that was
  /// asked for since the last change of a store that one process writes.
  virtual CurrentCell current_cell(const std::string& map, CellId id) const = 0;
  /// The same with its bytes, as it was when it was last read, where a store that many processes
  /// write has those of this hash (hexadecimal) in memory; nullopt is no error. The database is not
  /// asked, so that it may be slow or far: pose and revision are up to a minute old, and so is that
  /// the CELL is there, as with any cache along the way.
  virtual std::optional<CurrentCell> remembered_cell(const std::string& map, CellId id,
                                                     const std::string& hash) const = 0;
  /// The `count` <= 10,000 CELLs whose current positions are nearest to `position`, nearest first,
  /// by id where equally far.
  virtual std::vector<CellRecord> nearest(const std::string& map, const Eigen::Vector3d& position,
                                          std::size_t count) const = 0;
  /// The bytes that are kept of a CELL, as they were written (checksum verified).
  virtual StoredCell stored_cell(const std::string& map, CellId id) const = 0;
  /// A zstd frame of the encoded CELL: as it was written where it is kept raw, else made anew (see
  /// store/read_cell.hpp for the CELL itself).
  std::shared_ptr<const Bytes> compressed_cell(const std::string& map, CellId id) const;
  /// How the CELLs of a map, or of one session of it, are kept; by id.
  virtual std::vector<CellKeeping> keeping(
      const std::string& map, const std::optional<std::string>& session = {}) const = 0;
  /// Makes a session without CELLs; one that is there already, described alike, is left alone, and
  /// one without a description (its CELLs made it) takes this one. Error{kAlreadyExists} where it
  /// is described otherwise.
  virtual SessionInfo create_session(const std::string& map, const SessionInfo& session) = 0;
  /// By name. A session is also made by its first CELL, without a description.
  virtual std::vector<SessionInfo> sessions(const std::string& map) const = 0;
  /// Last CELL of a session (highest sequence), or nullopt.
  virtual std::optional<CellRecord> last_cell(const std::string& map,
                                              const std::string& session) const = 0;

  /// The pose graph at a revision (default: the current one), its constraints as they are judged
  /// now. Every revision can be read until a session is removed; Error{kNotFound} for one that is
  /// still to come.
  virtual PoseGraph pose_graph(const std::string& map,
                               std::optional<Revision> revision = {}) const = 0;
  /// What leads from revision `since` to the newest; Error{kNotFound} for one that is still to come
  /// (the map was deleted and made anew) or that a removed session made unreadable: start from 0.
  virtual MapChanges changes(const std::string& map, Revision since) const = 0;
  /// The drive of a session as stretches in order of sequence; empty for an unknown session.
  virtual std::vector<CellScans> scans(const std::string& map,
                                       const std::string& session) const = 0;

  virtual JobRecord create_job(JobRecord job) = 0;  ///< numbers it and stamps `created`, `updated`
  /// Replaces state, progress, error and `started`, and stamps `updated`. Map and kind never
  /// change: Error{kConflict}; the request stays as it was.
  virtual void update_job(const JobRecord& job) = 0;
  virtual JobRecord job(JobId id) const = 0;
  /// By id. A job names its map, which may not exist yet or any more.
  virtual std::vector<JobRecord> jobs(const std::optional<std::string>& map = {}) const = 0;

  /// Notified after every change of the store through this object, when it is durable and visible:
  /// how to wait for a map's next revision without asking again and again. Look at `version` after
  /// it, because any change of any map notifies.
  CommitSignal& committed() const { return committed_; }

  /// Cheap proof that the store can be read and written (readiness). Throws as any call would.
  virtual void check_ready() const = 0;

 private:
  mutable CommitSignal committed_;
};

void validate_map_name(const std::string& name);

}  // namespace cellmap
