#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/store/blob_cache.hpp"
#include "cellmap/store/blobs.hpp"
#include "cellmap/store/claims.hpp"
#include "cellmap/store/descriptions.hpp"
#include "cellmap/store/documents.hpp"
#include "cellmap/store/known_cells.hpp"
#include "cellmap/store/parts.hpp"
#include "cellmap/store/sql_pool.hpp"
#include "cellmap/store/sql_reads.hpp"
#include "cellmap/store/sql_update.hpp"
#include "cellmap/store/sql_writers.hpp"
#include "cellmap/store/staging.hpp"
#include "cellmap/store/store.hpp"

namespace cellmap {

/// What a store needs of a database.
struct SqlEngine {
  std::string name;                  ///< for messages: the file or address, without secrets
  std::shared_ptr<const void> held;  ///< what must outlive the connections, such as a lock
  SqlPool::Open open_reader;
  std::size_t max_readers = 16;
  std::unique_ptr<SqlConnection> writer;  ///< null where the store is read-only
  /// Where several maps can be written at the same time: more of these.
  SqlPool::Open open_writer = nullptr;
  std::size_t max_writers = 1;
  /// For claims, which then need not wait for what the writer does; null: they go through it.
  std::unique_ptr<SqlConnection> claimer = nullptr;
  std::size_t cache_bytes = 64u << 20;          ///< of hot CELL blobs
  std::optional<ObjectStoreOptions> objects{};  ///< nullopt: frames are in the tables
  /// Staged maps of this age were left by a crash; nullopt: all were, since nobody else writes, and
  /// what was claimed was claimed by processes that are gone.
  std::optional<std::chrono::hours> staging_limit;
  /// Nobody writes but through this store, for as long as it is open.
  bool is_only_writer = false;
};

/// A store in an SQL database whose schema is this build's. Engines differ in how they connect and
/// in what they can do besides.
class SqlStore : public Store,
                 public Documents,
                 public Staging,
                 public Claims,
                 public Parts,
                 public Descriptions {
 public:
  explicit SqlStore(SqlEngine engine);

  MapInfo create_map(const std::string& name, const LatticeSpec& lattice,
                     const CellForm& form) override;
  void delete_map(const std::string& name) override;
  void set_georeference(const std::string& map,
                        const std::optional<Georeference>& georeference) override;
  void set_form(const std::string& map, const CellForm& form) override;
  void put_document(const std::string& map, const std::string& name,
                    const std::string& text) override;
  std::optional<std::string> document(const std::string& map,
                                      const std::string& name) const override;
  void remove_document(const std::string& map, const std::string& name) override;
  std::vector<MapInfo> maps() const override;
  MapInfo map(const std::string& name) const override;
  std::string stage_map(const LatticeSpec& lattice) override;
  void publish_map(const std::string& staged, const std::string& name,
                   const std::optional<Along>& along) override;
  MapVersion version(const std::string& name) const override;
  CommitResult commit(const std::string& map, const MapUpdate& update) override;
  SessionInfo create_session(const std::string& map, const SessionInfo& session) override;
  std::vector<SessionInfo> sessions(const std::string& map) const override;
  CellPage cells(const std::string& map, const CellQuery& query) const override;
  CellRecord cell(const std::string& map, CellId id) const override;
  CurrentCell current_cell(const std::string& map, CellId id) const override;
  std::optional<CurrentCell> remembered_cell(const std::string& map, CellId id,
                                             const std::string& hash) const override;
  std::vector<CellRecord> nearest(const std::string& map, const Eigen::Vector3d& position,
                                  std::size_t count) const override;
  StoredCell stored_cell(const std::string& map, CellId id) const override;
  std::vector<CellKeeping> keeping(const std::string& map,
                                   const std::optional<std::string>& session) const override;
  std::optional<CellRecord> last_cell(const std::string& map,
                                      const std::string& session) const override;
  PoseGraph pose_graph(const std::string& map, std::optional<Revision> revision) const override;
  MapChanges changes(const std::string& map, Revision since) const override;
  std::vector<CellScans> scans(const std::string& map, const std::string& session) const override;
  void check_ready() const override;
  // Jobs and `Claims` (sql_store_jobs.cpp).
  JobRecord create_job(JobRecord job) override;
  void update_job(const JobRecord& job) override;
  JobRecord job(JobId id) const override;
  std::vector<JobRecord> jobs(const std::optional<std::string>& map) const override;
  JobRecord queue_job(JobRecord job, bool alone, const FindSame& find_same) override;
  std::optional<HeldJob> claim_job(const ClaimWish& wish) override;
  std::optional<JobHolder> extend_claim(const JobClaim& claim,
                                        std::chrono::milliseconds lease) override;
  void hand_back(const JobClaim& claim) override;
  JobRecord ask_to_cancel(JobId id) override;
  std::vector<HeldJob> unfinished_jobs(const std::optional<std::string>& map) const override;
  std::unique_ptr<Store> fenced(const JobClaim& claim) override;

  // Of `Parts` (sql_store_parts.cpp).
  void offer_parts(const std::vector<JobPart>& parts) override;
  std::vector<JobPartState> offered_parts(const JobClaim& claim) const override;
  bool retract_part(const JobPart& part) override;
  std::optional<Bytes> collect_part(const JobPart& part) override;
  std::vector<JobId> jobs_with_parts() const override;
  std::optional<JobPart> take_part(JobId job, const std::string& worker) override;
  bool deliver_part(const JobPart& part, const std::string& worker, const Bytes& made) override;
  void give_back_part(const JobPart& part, const std::string& worker) override;

  // Of `Descriptions` (sql_store_descriptions.cpp).
  std::vector<CellDescription> descriptions(const std::string& map,
                                            std::span<const CellId> cells) const override;
  void keep_descriptions(const std::string& map,
                         const std::vector<CellDescription>& descriptions) override;

  /// Inside one transaction: for what works on the tables themselves (store/copy_map.hpp).
  void read_tables(const std::function<void(SqlConnection&)>& read) const;
  /// The same while nobody else writes; durable when it returns. As `SqlWriters::Work`, `change`
  /// may be called again, as may that of the next one.
  void change_tables(const SqlWriters::Work& change) const;
  /// The same while nobody else writes to one map, whose row it is given.
  void change_map(const std::string& map,
                  const std::function<void(SqlConnection&, const MapRow&)>& change) const;
  const Blobs& blobs() const { return database_->blobs; }

 private:
  /// What a store shares with those that are fenced.
  struct Database {
    Database(SqlEngine engine, const Store& owner);
    void require_writable() const;

    const Store& owner;  ///< who is told of commits
    const std::string name;
    const std::shared_ptr<const void> held;
    SqlWriters writers;  ///< closed after the readers: who closes a file last tidies it
    std::mutex claiming;
    const std::unique_ptr<SqlConnection> claimer;  ///< under `claiming`
    SqlPool readers;
    BlobCache cache;
    const Blobs blobs;
    const bool is_only_writer;
    KnownCells known;
    KnownCells remembered;  ///< its states are minutes: what others change is not known
    MapSummaries summaries;
  };
  /// Compressed before the write, so that writers do it at the same time, and put where they are
  /// objects.
  UpdateFrames frames_of(const MapUpdate& update) const;
  /// Null where it has to be read.
  std::shared_ptr<const KnownCell> known_cell(const std::string& map, CellId id) const;
  CurrentCell with_bytes(const KnownCell& cell) const;
  SqlStore(std::shared_ptr<Database> database, const JobClaim& claim);
  static Stamp now();
  /// For changes of rows that they lock themselves, beside those of `writers`.
  void change_rows(const std::function<void(SqlConnection&)>& change) const {
    change_rows(change, &SqlConnection::begin_row_write);
  }
  /// The same for what is of no use after a crash.
  void change_passing_rows(const std::function<void(SqlConnection&)>& change) const {
    change_rows(change, &SqlConnection::begin_passing_write);
  }
  void change_rows(const std::function<void(SqlConnection&)>& change,
                   void (SqlConnection::*begin)()) const;

  std::shared_ptr<Database> database_;
  const std::optional<JobClaim> fence_;
};

}  // namespace cellmap
