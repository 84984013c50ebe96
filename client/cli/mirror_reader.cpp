#include "client/cli/mirror_reader.hpp"

#include <set>

#include "cellmap/client/mirror.hpp"
#include "client/cli/record_query.hpp"

namespace cellmap::cli {
namespace {

class MirrorReader : public MapReader {
 public:
  explicit MirrorReader(const std::filesystem::path& folder)
      : folder_(folder), mirror_(read_mirror(folder)) {
    std::erase_if(mirror_.cells,
                  [&](const auto& cell) { return !find_mirrored_cell(folder_, cell.second.hash); });
  }

  std::vector<MapInfo> maps() override { return {map(mirror_.map)}; }

  MapInfo map(const std::string& name) override {
    require(name);
    MapInfo info = mirror_.info;
    info.revision = mirror_.revision;
    info.cells = mirror_.cells.size();
    info.constraints = mirror_.pose_graph.constraints.size();
    info.planes = info.encoded_bytes = info.stored_bytes = 0;
    info.form = mirror_.form;
    info.kept.clear();
    info.bounds.setEmpty();
    std::set<std::string> sessions;
    for (const auto& [id, cell] : mirror_.cells) {
      info.planes += cell.planes;
      info.encoded_bytes += cell.encoded_bytes;
      const auto file = find_mirrored_cell(folder_, cell.hash);
      if (file) info.stored_bytes += std::filesystem::file_size(*file);
      info.bounds.extend(cell.T_map_cell.translation());
      sessions.insert(cell.session);
    }
    info.sessions.assign(sessions.begin(), sessions.end());
    return info;
  }

  CellPage cells(const std::string& map, const CellQuery& query) override {
    require(map);
    std::vector<CellRecord> records;
    for (const auto& [id, cell] : mirror_.cells) records.push_back(cell);
    return page_of(std::move(records), mirror_.revision, query);
  }

  EncodedCell cell(const std::string& map, const CellRecord& record) override {
    require(map);
    if (auto cell = read_mirrored_cell(folder_, record.hash)) return *std::move(cell);
    throw Error(ErrorCode::kNotFound, "CELL " + std::to_string(record.id.value) +
                                          " is not in the mirror '" + folder_.string() +
                                          "' any more; read it again");
  }

  void for_each_cell(
      const std::string& map, std::span<const CellRecord> cells,
      const std::function<void(const CellRecord&, const EncodedCell&)>& on_cell) override {
    for (const CellRecord& record : cells) on_cell(record, cell(map, record));
  }

  PoseGraph pose_graph(const std::string& map) override {
    require(map);
    return mirror_.pose_graph;
  }

  LoopList loops(const std::string& map) override {
    require(map);
    LoopList list{mirror_.revision, mirror_.pose_graph.constraints};
    std::erase_if(list.loops, [](const Constraint& c) { return c.kind != ConstraintKind::kLoop; });
    return list;
  }

  std::string trajectory_text(const std::string&, const std::string&, TrajectoryFormat,
                              TrajectoryStage) override {
    throw Error(ErrorCode::kUnsupported,
                "a mirror holds CELLs and poses but no trajectories; ask the server or the store");
  }

 private:
  void require(const std::string& name) const {
    if (name == mirror_.map) return;
    throw Error(ErrorCode::kNotFound, "the mirror '" + folder_.string() + "' holds map '" +
                                          mirror_.map + "', not '" + name + "'");
  }

  std::filesystem::path folder_;
  Mirror mirror_;
};

}  // namespace

std::unique_ptr<MapReader> open_mirror(const std::filesystem::path& folder) {
  return std::make_unique<MirrorReader>(folder);
}

}  // namespace cellmap::cli
