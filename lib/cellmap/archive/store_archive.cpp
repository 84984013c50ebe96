#include "cellmap/archive/store_archive.hpp"

#include <algorithm>

#include "cellmap/core/error.hpp"
#include "cellmap/store/read_cell.hpp"
#include "cellmap/store/staging.hpp"

namespace cellmap {
namespace {

ArchiveContents contents_of(const Store& store, const std::string& map) {
  ArchiveContents contents;
  contents.map = map;
  contents.graph = store.pose_graph(map);  // first: what comes later only adds to it
  const MapInfo info = store.map(map);
  contents.created = info.created;
  contents.georeference = info.georeference;
  for (const SessionInfo& session : store.sessions(map)) {
    contents.sessions.push_back(
        {session.name, session.robot, session.sensor, session.odometry_frame, session.started});
    for (CellScans& stretch : store.scans(map, session.name)) {
      const CellId id = stretch.cell;
      if (contents.graph.nodes.contains(id)) contents.stretches.emplace(id, std::move(stretch));
    }
  }
  return contents;
}

/// A map in the making: nobody sees it before it is whole, and it is gone again unless it is
/// finished.
class Restoration {
 public:
  Restoration(ArchiveReader& archive, Store& store, const std::string& map)
      : archive_(archive),
        store_(store),
        staged_(store, archive.head().lattice, map),
        map_(staged_.name()) {
    const ArchiveFooter& footer = archive_.footer();
    if (footer.encoding == ArchiveEncoding::kCompact) form_ = compact_form(footer.bound_m);
    store_.set_form(map_, form_);
  }

  void make_sessions() {
    for (const ArchiveSession& session : archive_.footer().sessions) {
      SessionInfo info;
      info.name = session.name;
      info.robot = session.robot;
      info.sensor = session.sensor;
      info.odometry_frame = session.odometry_frame;
      info.started = session.started;
      store_.create_session(map_, info);
    }
  }

  void add(const ArchivedCell& listed, const ArchiveCell& cell) {
    NewCell added;
    added.id = cell.id;
    const bool exact = cell.encoding != ArchiveEncoding::kCompact;
    KeptCell kept = exact ? keep_cell(std::make_shared<const Cell>(cell.cell), form_)
                          : keep_coded_cell(cell.coded, form_);
    if (cell.raw_hash != listed.hash || (exact && kept.encoded.hash != listed.hash)) {
      throw Error(ErrorCode::kCorruptData,
                  "CELL " + std::to_string(cell.id.value) +
                      " of the archive has not the hash that its list says; run 'cellmap verify'");
    }
    added.cell = std::move(kept.cell);
    added.encoded = std::move(kept.encoded);
    added.coded = std::move(kept.coded);
    const PoseGraph& graph = archive_.pose_graph();
    added.T_map_cell = graph.nodes.at(cell.id);
    added.unaligned = graph.unaligned.contains(cell.id);
    const auto stretch = archive_.scans().find(cell.id);
    if (stretch != archive_.scans().end()) {
      added.scans = stretch->second.scans;
      added.raw_points = stretch->second.raw_points;
      added.voxel_points = stretch->second.voxel_points;
    }
    MapUpdate update;
    update.cells.push_back(std::move(added));
    store_.commit(map_, update);
  }

  MapInfo finish() {
    constexpr std::size_t kConstraints = 100'000;
    const auto& constraints = archive_.pose_graph().constraints;
    for (std::size_t i = 0; i < constraints.size(); i += kConstraints) {
      MapUpdate update;
      for (std::size_t k = i; k < std::min(i + kConstraints, constraints.size()); ++k) {
        update.add_constraints.push_back(constraints[k]);
        update.add_constraints.back().id = {};
      }
      store_.commit(map_, update);
    }
    if (const auto& georeference = archive_.footer().georeference) {
      store_.set_georeference(map_, georeference);
    }
    return staged_.publish();
  }

 private:
  ArchiveReader& archive_;
  Store& store_;
  StagedMap staged_;
  const std::string& map_;  ///< its name until then
  CellForm form_;
};

}  // namespace

ArchiveOptions default_archive_options(const MapInfo& map) {
  ArchiveOptions options;
  for (const auto& [form, cells] : map.kept) {
    if (form.is_exact()) continue;
    options.bound_m = options.encoding == ArchiveEncoding::kCompact
                          ? std::max(options.bound_m, form.bound_m())
                          : form.bound_m();
    options.encoding = ArchiveEncoding::kCompact;
  }
  return options;
}

void archive_map(const Store& store, const std::string& map, ByteFile& file,
                 const ArchiveOptions& options, const std::stop_token& stop,
                 const ProgressCallback& progress) {
  const ArchiveContents contents = contents_of(store, map);
  ArchiveWriter writer(file, store.map(map).lattice, options);
  Progress done;
  for (const auto& [id, pose] : contents.graph.nodes) {
    throw_if_stopped(stop);
    writer.add(id, read_kept_cell(store, map, id));
    ++done.cells_done;
    if (progress) progress(done);
  }
  writer.finish(contents);
}

MapInfo restore_map(ArchiveReader& archive, Store& store, const std::string& map,
                    const std::stop_token& stop, const ProgressCallback& progress) {
  archive.scans();  // everything but the CELLs is read, and refused, before a map is made
  archive.pose_graph();
  const std::vector<ArchivedCell> listed = archive.cells();
  std::vector<CellId> ids;
  for (const ArchivedCell& cell : listed) ids.push_back(cell.id);
  Restoration restoration(archive, store, map);
  restoration.make_sessions();
  Progress done;
  archive.for_each_cell(ids, [&](const ArchiveCell& cell) {
    throw_if_stopped(stop);
    restoration.add(listed[done.cells_done], cell);
    ++done.cells_done;
    if (progress) progress(done);
  });
  return restoration.finish();
}

MapInfo map_info(ArchiveReader& archive) {
  const ArchiveFooter& footer = archive.footer();
  const PoseGraph& graph = archive.pose_graph();
  MapInfo info;
  info.name = footer.map;
  info.lattice = footer.lattice;
  info.revision = graph.revision;
  info.created = footer.created;
  info.cells = footer.cells;
  info.planes = footer.planes;
  info.constraints = graph.constraints.size();
  info.encoded_bytes = footer.cell_bytes;
  info.stored_bytes = archive.head().records_end - kArchiveFirstReadBytes;
  info.scans = footer.scans;
  info.georeference = footer.georeference;
  info.form = footer.encoding == ArchiveEncoding::kCompact ? compact_form(footer.bound_m)
                                                           : CellForm{footer.encoding, 0};
  if (info.cells > 0) info.kept[info.form] = info.cells;
  info.bounds.setEmpty();
  for (const auto& [id, pose] : graph.nodes) info.bounds.extend(pose.translation());
  for (const ArchiveSession& session : footer.sessions) info.sessions.push_back(session.name);
  for (const auto& [id, stretch] : archive.scans()) {
    info.raw_points += stretch.raw_points;
    info.voxel_points += stretch.voxel_points;
  }
  return info;
}

std::vector<CellRecord> cell_records(ArchiveReader& archive) {
  const ArchiveFooter& footer = archive.footer();
  const PoseGraph& graph = archive.pose_graph();
  std::vector<CellRecord> records;
  for (const ArchivedCell& cell : archive.cells()) {
    CellRecord record;
    record.id = cell.id;
    record.hash = cell.hash;
    record.added = record.moved = graph.revision;
    record.T_map_cell = graph.nodes.at(cell.id);
    record.session = footer.sessions[cell.session].name;
    record.sequence = cell.sequence;
    record.planes = cell.planes;
    record.encoded_bytes = cell.bytes;
    records.push_back(std::move(record));
  }
  return records;
}

}  // namespace cellmap
