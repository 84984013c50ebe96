#pragma once

#include <chrono>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "cellmap/client/cell_cache.hpp"
#include "cellmap/client/resources.hpp"
#include "cellmap/client/retry.hpp"
#include "cellmap/client/url.hpp"

namespace cellmap {

struct ClientOptions {
  std::string url = "http://127.0.0.1:8080";  ///< as `parse_server_url` reads it
  std::chrono::milliseconds connect_timeout{5'000};
  /// Longest silence of the server within an answer. Relocalising without a prior in a large map
  /// is the slowest call.
  std::chrono::milliseconds read_timeout{120'000};
  std::chrono::milliseconds write_timeout{30'000};
  RetryOptions retry;
  std::filesystem::path cache_directory;  ///< of CELLs; empty: no cache
  std::uint64_t cache_max_bytes = 1ull << 30;
  int compression_level = 1;  ///< zstd level of uploaded scans and CELLs, 1 to 19; 0: uncompressed
  std::string user_agent = "cellmap-client";
  /// Sent to `url` as a bearer token; empty: none. Over plain http everyone on the way can read it.
  std::string token{};

  /// Throws Error{kInvalidArgument} naming the option and its range.
  void validate() const;
};

/// Talks to a CELLmap server: every resource of its API (schema/openapi.yaml) as a typed call.
///
/// Errors, of every call: the server's problem document becomes an Error with the same code and the
/// server's explanation. No connection, or an overloaded server, after the retries of
/// `RetryOptions`: Error{kUnavailable}. A connection that breaks: Error{kIo}. Bytes that fail their
/// hash or their format, and JSON that is not as the API describes it: Error{kCorruptData}.
/// An answer over its limit (64 MiB of JSON, `kMaxCellBytes` a CELL, 512 MiB a batch):
/// Error{kTooLarge}.
///
/// One keep-alive connection, opened with the first call. No threads of its own. An object serves
/// one thread at a time; use one a thread (they may share the cache directory).
class Client {
 public:
  /// Checks options and address, opens the cache; does not connect.
  explicit Client(ClientOptions options);
  const ClientOptions& options() const;
  ~Client();
  Client(Client&&) noexcept;
  Client& operator=(Client&&) noexcept;

  const ServerUrl& url() const;
  Traffic traffic() const;  ///< since it was made

  // --- service ------------------------------------------------------------------------------

  /// Returns where the server can serve; Error{kUnavailable} where it cannot.
  void check_ready();
  std::string metrics();       ///< Prometheus text
  std::string openapi_yaml();  ///< the description of the API that the server carries

  // --- maps ---------------------------------------------------------------------------------

  std::vector<MapInfo> maps();
  /// Error{kAlreadyExists} where the name is taken. Not idempotent.
  MapInfo create_map(const std::string& name, const LatticeSpec& lattice = {},
                     const CellForm& form = {});
  MapInfo map(const std::string& name);
  void delete_map(const std::string& name);
  /// Starts the job that brings a map's CELLs into a form, also those to come. Error{kConflict}
  /// where CELLs are kept within a wider bound. Not idempotent, but done twice it changes nothing
  /// more.
  Job convert(const std::string& map, const CellForm& form);

  // --- CELLs --------------------------------------------------------------------------------

  /// One page; follow `next_cursor` for more, or use `all_cells`.
  CellPage cells(const std::string& map, const CellQuery& query = {});
  /// Every CELL that the query names, page by page (`limit` and `cursor` are set here). Revisions
  /// of the pages may differ where the map changes meanwhile.
  std::vector<CellRecord> all_cells(const std::string& map, CellQuery query = {});

  /// One CELL, verified. With a cache: conditional (If-None-Match), and no bytes are sent where
  /// the cache has what the server names.
  FetchedCell cell(const std::string& map, CellId id);

  /// Stores a CELL. The same content again is no error; other content is Error{kConflict}.
  /// `T_map_cell` defaults to the pose that the CELL was born at.
  PutCellResult put_cell(const std::string& map, CellId id, const EncodedCell& cell,
                         const std::optional<Pose>& T_map_cell = {});

  /// CELLs by id in one answer, each verified; from the cache where it has them is up to the caller
  /// (`cells` gives the hashes). The server may cut the answer: see `CellBatch::remaining`.
  CellBatch cells_batch(const std::string& map, std::span<const CellId> ids);
  /// CELLs added after a revision in one answer.
  CellBatch cells_batch_since(const std::string& map, Revision since);
  /// The CELLs of a list, through the cache and as many batches as it takes. Calls `on_cell` once
  /// a CELL, in no particular order.
  void for_each_cell(const std::string& map, std::span<const CellRecord> cells,
                     const std::function<void(const CellRecord&, const EncodedCell&)>& on_cell);

  /// Where the map lies on Earth; nullopt takes it back. Relocalisation then also says GeoPoses.
  void set_georeference(const std::string& map, const std::optional<Georeference>& georeference);

  // --- pose graph -----------------------------------------------------------------------------

  PoseGraph pose_graph(const std::string& map, std::optional<Revision> revision = {});
  /// What leads from a revision to the newest one, in as few bytes as the server can say it
  /// (FlatBuffers and zstd; JSON from a server that knows nothing else). Poses of moved CELLs are
  /// within 0.11 mm and 8.3e-7 rad of the server's, however many updates came before. `wait`: the
  /// answer is held back for so long while the map has no other revision than `since`, and then is
  /// empty; at most a minute, and half of `read_timeout`. Error{kNotFound} where the map is gone or
  /// has not yet come to `since`; a server that cannot wait: Error{kInvalidArgument}.
  Changes changes(const std::string& map, Revision since, std::chrono::milliseconds wait = {});
  /// Follows a map's revisions over server-sent events until `on_event` returns false, a stop is
  /// requested or the stream ends (the server stops, the map is deleted). `known`: no event for it
  /// to begin with. `on_event` is also called every few seconds of silence, with nothing. One
  /// attempt, on a connection of its own; `on_event` may call this client meanwhile. Returns false
  /// where there is no stream to be had, or it broke: not a sign of life for 20 s.
  bool follow_revisions(const std::string& map, std::optional<Revision> known,
                        const std::function<bool(const std::optional<RevisionEvent>&)>& on_event,
                        std::stop_token stop = {});
  /// The drive of a session, as text in the asked format, one row a scan.
  std::string trajectory_text(const std::string& map, const std::string& session,
                              TrajectoryFormat format,
                              TrajectoryStage stage = TrajectoryStage::kCorrected);

  // --- sessions -------------------------------------------------------------------------------

  std::vector<Session> sessions(const std::string& map);
  Session session(const std::string& map, const std::string& name);
  /// Says who drives; name, robot, sensor, odometry frame and start of `session` count. The same
  /// again is no error; Error{kAlreadyExists} where it is described otherwise.
  Session create_session(const std::string& map, const SessionInfo& session);
  /// Which of these CELLs of a session the server lacks, in the order asked; at most 10,000.
  std::vector<ContentHash> lacking_cells(const std::string& map, const std::string& session,
                                         std::span<const ContentHash> hashes);
  /// Adds the next CELL of a drive, which the server ties to the map. Idempotent;
  /// Error{kConflict} for one that is not next.
  SessionCell put_session_cell(const std::string& map, const EncodedCell& cell);
  /// How far the server is with the scans of a drive, also of one that has not begun.
  SessionScans session_scans(const std::string& map, const std::string& session);
  /// Sends the next scans of a drive in one request: 1 to `kMaxBatchScans` with indices one after
  /// the other, and together at most `kMaxScanPoints` points. Goes into the session's upload job,
  /// which is made where none runs. Idempotent. Fewer scans may be taken, or none where the server
  /// wants others first: `next_scan` of the answer says where to go on. A full queue is waited out
  /// as Retry-After says, then Error{kUnavailable}; Error{kConflict} where the session is stopped,
  /// or read from a path.
  SessionScans post_session_scans(const std::string& map, const std::string& session,
                                  std::span<const PosedScan> scans);
  /// Says that the drive has ended. Idempotent.
  SessionScans complete_session(const std::string& map, const std::string& session);

  /// Removes a session with its CELLs and constraints. Error{kConflict} while jobs are unfinished.
  void delete_session(const std::string& map, const std::string& name);
  /// Starts the job that copies sessions (empty: all) of map `from` into a map and joins them to
  /// it. Not idempotent, but done twice it changes nothing more.
  Job merge(const std::string& map, const std::string& from,
            const std::set<std::string>& sessions = {});
  /// Moves sessions into a new map, which is returned.
  MapInfo split(const std::string& map, const std::set<std::string>& sessions,
                const std::string& into);

  // --- relocalisation and loops ---------------------------------------------------------------

  /// Where a scan (sensor frame) was taken. "Not found" is an answer, no error.
  Relocalisation relocalise(const std::string& map, const PointCloud& scan,
                            const std::optional<PosePrior>& prior = {});
  /// Where a CELL of the map's lattice was built: found more surely than one scan. The answer's
  /// scan is the CELL.
  Relocalisation relocalise(const std::string& map, const EncodedCell& cell,
                            const std::optional<PosePrior>& prior = {});

  LoopList loops(const std::string& map);
  /// With its evidence, and how it stands at the poses of now.
  ConstraintReport loop(const std::string& map, ConstraintId id);
  /// Adds a measured constraint and optimises. `information` (translation, rotation) defaults to
  /// the server's. Not idempotent: a broken connection leaves it open whether it was added.
  LoopReport add_loop(const std::string& map, CellId from, CellId to, const Pose& T_from_to,
                      const std::optional<Matrix6d>& information = {});
  /// Looks for loops of a CELL, adds what passes and optimises.
  LoopReport detect_loops(const std::string& map, CellId cell);
  /// A pinned loop counts in full, whatever contradicts it; optimises.
  LoopReport pin_loop(const std::string& map, ConstraintId id, bool pinned);
  /// Removes a loop and optimises without it.
  LoopReport delete_loop(const std::string& map, ConstraintId id);

  // --- jobs -----------------------------------------------------------------------------------

  std::vector<Job> jobs(const std::string& map);
  Job job(JobId id);
  /// Starts an ingest. A session that is stored in part goes on after its last CELL, one that is
  /// stored whole ends at once; Error{kConflict} where another unfinished job ingests it.
  Job start_ingest(const std::string& map, const IngestRequest& request);
  /// Sends the next scan of an upload. Another index being expected is a value; a full queue
  /// is waited out as Retry-After says, then Error{kUnavailable}.
  PutScanResult put_scan(JobId id, const PosedScan& scan);
  /// Says that there are no more scans; with `scans`, that there were so many: Error{kConflict}
  /// where the server expects another one next, so that none is missing unnoticed.
  Job complete_upload(JobId id, std::optional<std::uint64_t> scans = {});
  Job cancel_job(JobId id);
  /// Waits until a job reaches a final state, over server-sent events, or by asking every
  /// half second where those fail. Calls `on_progress` with what arrives. Returns the final job, or
  /// the latest one where a stop was requested: the job itself goes on. A server that stays away
  /// longer than the retries ends it with Error{kUnavailable}.
  Job follow_job(JobId id, const std::function<void(const Job&)>& on_progress = {},
                 std::stop_token stop = {});

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
