#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "cellmap/client/client.hpp"
#include "cellmap/store/store.hpp"

namespace CLI {
class App;
}

namespace cellmap::cli {

/// Where the maps are: behind a server, in a store file of this machine, or one of them in a
/// mirror or an archive.
struct Place {
  std::string server;      ///< --server URL, or the environment's CELLMAP_SERVER
  std::string store;       ///< --store FILE
  std::string mirror;      ///< --mirror DIR, as `cellmap pull` keeps it
  std::string archive;     ///< --archive FILE or URL, as `cellmap archive` writes it
  std::string cache;       ///< --cache DIR, or CELLMAP_CACHE: CELLs kept between calls
  std::string token_file;  ///< --token-file FILE, or CELLMAP_TOKEN_FILE; else CELLMAP_TOKEN counts
  double timeout_s = 120;  ///< --timeout

  /// True where no server works on it.
  bool is_offline() const { return !store.empty() || !mirror.empty() || !archive.empty(); }
};

/// Declares --server, --token-file, --cache and --timeout, --store where `with_store`, and --mirror
/// and
/// --archive where `with_mirror` (verbs that only read).
void add_place_options(CLI::App& verb, Place& place, bool with_store, bool with_mirror = false);

/// A client for the place. Throws Error{kInvalidArgument} where no server was named.
Client connect(const Place& place);

/// Opens an existing store. Throws Error{kNotFound} where there is no such file: reading never
/// makes one.
std::unique_ptr<Store> open_existing_store(const std::string& file);

/// Reads maps, wherever they are. Errors are those of `Client` and `Store`.
class MapReader {
 public:
  virtual ~MapReader() = default;
  virtual std::vector<MapInfo> maps() = 0;
  virtual MapInfo map(const std::string& name) = 0;
  virtual CellPage cells(const std::string& map, const CellQuery& query) = 0;
  virtual EncodedCell cell(const std::string& map, const CellRecord& record) = 0;
  virtual void for_each_cell(
      const std::string& map, std::span<const CellRecord> cells,
      const std::function<void(const CellRecord&, const EncodedCell&)>& on_cell) = 0;
  virtual PoseGraph pose_graph(const std::string& map) = 0;
  virtual LoopList loops(const std::string& map) = 0;
  virtual ConstraintReport loop(const std::string& map, ConstraintId id);
  virtual std::string trajectory_text(const std::string& map, const std::string& session,
                                      TrajectoryFormat format, TrajectoryStage stage) = 0;

  /// Every page of `cells`.
  std::vector<CellRecord> all_cells(const std::string& map);
};

/// The poses of a drive's scans as text. Throws as `corrected_trajectory`.
std::string text_of(std::span<const CellScans> stretches, const PoseGraph& graph,
                    TrajectoryFormat format, TrajectoryStage stage);

/// The archive where one was named, else the mirror, the store, or the server. Throws
/// Error{kInvalidArgument} where nothing was named.
std::unique_ptr<MapReader> open_reader(const Place& place);

}  // namespace cellmap::cli
