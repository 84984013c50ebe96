#pragma once

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/store/blob_cache.hpp"
#include "cellmap/store/current_cell.hpp"
#include "cellmap/store/documents.hpp"
#include "cellmap/store/group_commit.hpp"
#include "cellmap/store/known_cells.hpp"
#include "cellmap/store/sql_pool.hpp"
#include "cellmap/store/sql_reads.hpp"
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
  std::size_t cache_bytes = 64u << 20;    ///< of hot CELL blobs
  /// Staged maps of this age were left by a crash; nullopt: all were, since nobody else writes.
  std::optional<std::chrono::hours> staging_limit;
  /// Nobody writes but through this store, for as long as it is open.
  bool is_only_writer = false;
};

/// A store in an SQL database whose schema is this build's. Engines differ in how they connect and
/// in what they can do besides.
class SqlStore : public Store, public Documents, public Staging, public CurrentCells {
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
  JobRecord create_job(JobRecord job) override;
  void update_job(const JobRecord& job) override;
  JobRecord job(JobId id) const override;
  std::vector<JobRecord> jobs(const std::optional<std::string>& map) const override;
  void check_ready() const override;

  /// Inside one transaction: for what works on the tables themselves (store/copy_map.hpp).
  void read_tables(const std::function<void(SqlConnection&)>& read) const;
  /// The same with the connection that writes; durable when it returns.
  void change_tables(const std::function<void(SqlConnection&)>& change) const;

 private:
  void execute(const std::vector<GroupCommit::Write*>& batch) noexcept;
  /// Null where it has to be read.
  std::shared_ptr<const KnownCell> known_cell(const std::string& map, CellId id) const;

  const std::string name_;
  const std::shared_ptr<const void> held_;
  const std::unique_ptr<SqlConnection> writer_;  ///< of the head of `commits_`
  mutable SqlPool readers_;
  mutable BlobCache cache_;
  const bool is_only_writer_;
  mutable KnownCells known_;
  mutable MapSummaries summaries_;
  mutable GroupCommit commits_;
};

}  // namespace cellmap
