#include "client/cli/map_reader.hpp"

#include <CLI/CLI.hpp>
#include <filesystem>

#include "cellmap/pipeline/refine.hpp"
#include "cellmap/pose_graph/edit.hpp"
#include "cellmap/store/open_store.hpp"
#include "cellmap/store/read_cell.hpp"
#include "cellmap/store/store_place.hpp"
#include "client/cli/archive_reader.hpp"
#include "client/cli/client_options.hpp"
#include "client/cli/mirror_reader.hpp"
#include "client/cli/read_token.hpp"
#include "client/cli/store_blobs.hpp"

namespace cellmap::cli {
namespace {

class ServerReader : public MapReader {
 public:
  explicit ServerReader(const Place& place) : client_(connect(place)) {}
  std::vector<MapInfo> maps() override { return client_.maps(); }
  MapInfo map(const std::string& name) override { return client_.map(name); }
  CellPage cells(const std::string& map, const CellQuery& query) override {
    return client_.cells(map, query);
  }
  EncodedCell cell(const std::string& map, const CellRecord& record) override {
    return client_.cell(map, record.id).encoded;
  }
  void for_each_cell(
      const std::string& map, std::span<const CellRecord> cells,
      const std::function<void(const CellRecord&, const EncodedCell&)>& on_cell) override {
    client_.for_each_cell(map, cells, on_cell);
  }
  PoseGraph pose_graph(const std::string& map) override { return client_.pose_graph(map); }
  LoopList loops(const std::string& map) override { return client_.loops(map); }
  ConstraintReport loop(const std::string& map, ConstraintId id) override {
    return client_.loop(map, id);
  }
  std::string trajectory_text(const std::string& map, const std::string& session,
                              TrajectoryFormat format, TrajectoryStage stage) override {
    return client_.trajectory_text(map, session, format, stage);
  }

 private:
  Client client_;
};

class StoreReader : public MapReader {
 public:
  explicit StoreReader(const std::string& file) : store_(open_existing_store(file)) {}
  std::vector<MapInfo> maps() override { return store_->maps(); }
  MapInfo map(const std::string& name) override { return store_->map(name); }
  CellPage cells(const std::string& map, const CellQuery& query) override {
    return store_->cells(map, query);
  }
  EncodedCell cell(const std::string& map, const CellRecord& record) override {
    return read_encoded_cell(*store_, map, record.id);
  }
  void for_each_cell(
      const std::string& map, std::span<const CellRecord> cells,
      const std::function<void(const CellRecord&, const EncodedCell&)>& on_cell) override {
    for (const CellRecord& record : cells) on_cell(record, cell(map, record));
  }
  PoseGraph pose_graph(const std::string& map) override { return store_->pose_graph(map); }
  LoopList loops(const std::string& map) override {
    PoseGraph graph = store_->pose_graph(map);
    std::erase_if(graph.constraints,
                  [](const Constraint& c) { return c.kind != ConstraintKind::kLoop; });
    return {graph.revision, std::move(graph.constraints)};
  }
  std::string trajectory_text(const std::string& map, const std::string& session,
                              TrajectoryFormat format, TrajectoryStage stage) override {
    const std::vector<CellScans> stretches = store_->scans(map, session);
    if (stretches.empty()) {
      throw Error(ErrorCode::kNotFound,
                  "map '" + map + "' has no scans of a session '" + session + "'");
    }
    return text_of(stretches, store_->pose_graph(map), format, stage);
  }

 private:
  std::unique_ptr<Store> store_;
};

}  // namespace

std::string text_of(std::span<const CellScans> stretches, const PoseGraph& graph,
                    TrajectoryFormat format, TrajectoryStage stage) {
  if (stage == TrajectoryStage::kCorrected) {
    return to_text(corrected_trajectory(stretches, graph.nodes), format);
  }
  std::vector<StampedPose> poses;
  for (const CellScans& stretch : stretches) {
    for (const ScanInCell& scan : stretch.scans) {
      poses.push_back({scan.stamp, stretch.T_odom_cell * scan.T_cell_scan});
    }
  }
  return to_text(Trajectory(std::move(poses)), format);
}

ConstraintReport MapReader::loop(const std::string& map, ConstraintId id) {
  return explain(pose_graph(map), id);
}

void add_place_options(CLI::App& verb, Place& place, bool with_store, bool with_mirror) {
  auto* server = verb.add_option("--server", place.server,
                                 "Address of the server, for example http://127.0.0.1:8080");
  server->envname("CELLMAP_SERVER");
  verb.add_option("--token-file", place.token_file,
                  "File that holds the token for the server (default: the environment's "
                  "CELLMAP_TOKEN)")
      ->envname("CELLMAP_TOKEN_FILE");
  if (with_store) {
    verb.add_option("--store", place.store,
                    "Store: a file of this machine or postgresql://..., instead of --server");
  }
  if (with_mirror) {
    verb.add_option("--mirror", place.mirror,
                    "Folder that 'cellmap pull' keeps, instead of --server: works offline");
    verb.add_option("--archive", place.archive,
                    "File of 'cellmap archive', or its http:// address on any web server, instead "
                    "of --server");
  }
  verb.add_option("--cache", place.cache, "Folder that keeps fetched CELLs (default: none)")
      ->envname("CELLMAP_CACHE");
  verb.add_option("--timeout", place.timeout_s, "Longest silence of the server, seconds")
      ->capture_default_str()
      ->check(CLI::Range(0.1, 86'400.0));
}

ClientOptions client_options_of(const Place& place) {
  if (place.server.empty()) {
    throw Error(ErrorCode::kInvalidArgument,
                "no server was named; give --server http://HOST:PORT or set CELLMAP_SERVER");
  }
  ClientOptions options;
  options.url = place.server;
  options.cache_directory = place.cache;
  options.read_timeout = std::chrono::milliseconds(static_cast<long>(place.timeout_s * 1000));
  options.user_agent = "cellmap/" CELLMAP_VERSION;
  options.token = read_token(place.token_file);
  return options;
}

Client connect(const Place& place) { return Client(client_options_of(place)); }

std::unique_ptr<Store> open_existing_store(const std::string& place) {
  const auto file = store_file(place);
  if (file && !std::filesystem::exists(*file)) {
    throw Error(ErrorCode::kNotFound, "there is no store '" + place +
                                          "'; make one with 'cellmap build DATASET --store " +
                                          place + " --map NAME'");
  }
  return open_store(place, objects_of_environment());
}

std::vector<CellRecord> MapReader::all_cells(const std::string& map) {
  std::vector<CellRecord> all;
  CellQuery query;
  do {
    const CellPage page = cells(map, query);
    all.insert(all.end(), page.cells.begin(), page.cells.end());
    query.cursor = page.next_cursor;
  } while (!query.cursor.empty());
  return all;
}

std::unique_ptr<MapReader> open_reader(const Place& place) {
  if (!place.archive.empty()) return open_archive_reader(place);
  if (!place.mirror.empty()) return open_mirror(place.mirror);
  if (!place.store.empty()) return std::make_unique<StoreReader>(place.store);
  if (place.server.empty()) {
    throw Error(ErrorCode::kInvalidArgument,
                "say where the map is: --server http://HOST:PORT, --store FILE, --mirror DIR "
                "or --archive FILE");
  }
  return std::make_unique<ServerReader>(place);
}

}  // namespace cellmap::cli
