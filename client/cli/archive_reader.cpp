#include "client/cli/archive_reader.hpp"

#include "cellmap/archive/store_archive.hpp"
#include "cellmap/client/range_source.hpp"
#include "client/cli/client_options.hpp"
#include "client/cli/record_query.hpp"

namespace cellmap::cli {
namespace {

class ArchiveMapReader : public MapReader {
 public:
  explicit ArchiveMapReader(const Place& place)
      : name_(place.archive), archive_(open_bytes(place.archive, place)) {}

  std::vector<MapInfo> maps() override { return {map_info(archive_)}; }

  MapInfo map(const std::string& name) override {
    require(name);
    return map_info(archive_);
  }

  CellPage cells(const std::string& map, const CellQuery& query) override {
    require(map);
    return page_of(cell_records(archive_), archive_.pose_graph().revision, query);
  }

  EncodedCell cell(const std::string& map, const CellRecord& record) override {
    require(map);
    return encode_cell(archive_.cell(record.id).cell);
  }

  void for_each_cell(
      const std::string& map, std::span<const CellRecord> cells,
      const std::function<void(const CellRecord&, const EncodedCell&)>& on_cell) override {
    require(map);
    std::vector<CellId> ids;
    for (const CellRecord& record : cells) ids.push_back(record.id);
    auto record = cells.begin();
    archive_.for_each_cell(
        ids, [&](const ArchiveCell& cell) { on_cell(*record++, encode_cell(cell.cell)); });
  }

  PoseGraph pose_graph(const std::string& map) override {
    require(map);
    return archive_.pose_graph();
  }

  LoopList loops(const std::string& map) override {
    PoseGraph graph = pose_graph(map);
    std::erase_if(graph.constraints,
                  [](const Constraint& c) { return c.kind != ConstraintKind::kLoop; });
    return {graph.revision, std::move(graph.constraints)};
  }

  std::string trajectory_text(const std::string& map, const std::string& session,
                              TrajectoryFormat format, TrajectoryStage stage) override {
    require(map);
    std::vector<CellScans> stretches;
    for (const CellRecord& record : cell_records(archive_)) {
      const auto stretch = archive_.scans().find(record.id);
      if (record.session != session || stretch == archive_.scans().end()) continue;
      stretches.push_back(stretch->second);
    }
    if (stretches.empty()) {
      throw Error(ErrorCode::kNotFound,
                  "map '" + map + "' has no scans of a session '" + session + "'");
    }
    return text_of(stretches, archive_.pose_graph(), format, stage);
  }

 private:
  void require(const std::string& map) {
    if (map == archive_.footer().map) return;
    throw Error(ErrorCode::kNotFound, "the archive '" + name_ + "' holds map '" +
                                          archive_.footer().map + "', not '" + map + "'");
  }

  std::string name_;
  ArchiveReader archive_;
};

bool same_origin(const std::string& url, const std::string& server) {
  const auto path = url.find('/', url.find("://") + 3);
  const ServerUrl a = parse_server_url(url.substr(0, path)), b = parse_server_url(server);
  return a.scheme == b.scheme && a.host == b.host && a.port == b.port;
}

}  // namespace

std::unique_ptr<ByteSource> open_bytes(const std::string& file_or_url, const Place& place) {
  if (!is_http_url(file_or_url)) return open_file(file_or_url, FileMode::kRead);
  Place server = place;
  if (server.server.empty()) server.server = "http://unused";
  ClientOptions options = client_options_of(server);
  // A token is for its server, not for whoever hands out archives.
  if (!same_origin(file_or_url, server.server)) options.token.clear();
  return open_http_file(file_or_url, std::move(options));
}

std::unique_ptr<MapReader> open_archive_reader(const Place& place) {
  return std::make_unique<ArchiveMapReader>(place);
}

}  // namespace cellmap::cli
