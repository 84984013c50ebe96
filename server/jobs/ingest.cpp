#include "server/jobs/ingest.hpp"

#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/geometry/voxel_grid.hpp"
#include "cellmap/pipeline/mapper.hpp"

namespace cellmap::server {
namespace {

constexpr double kVoxelSize_m = 0.4;
constexpr std::size_t kMaxVoxels = 15'000'000;

MapUpdate to_map_update(const CellUpdate& update) {
  MapUpdate result;
  NewCell cell{.id = update.id,
               .cell = update.cell,
               .encoded = encode_cell(*update.cell),
               .T_map_cell = update.poses.at(update.id),
               .scans = update.scans,
               .raw_points = update.raw_points};
  result.cells.push_back(std::move(cell));
  result.poses = update.poses;
  result.poses.erase(update.id);
  result.add_constraints = update.constraints;
  return result;
}

/// One run: the mapper and what it shares with the store.
class Ingest {
 public:
  Ingest(Maps& maps, const std::string& map, const IngestRequest& request, ScanSource& source,
         const std::stop_token& stop, const IngestHooks& hooks)
      : store_(maps.store()),
        state_(maps.open(map)),
        request_(request),
        source_(source),
        stop_(stop),
        hooks_(hooks),
        earlier_voxels_(store_.map(map).voxel_points) {
    progress_.scans_total = source.size();
  }

  void run() {
    const auto resume = find_resume_point(store_, state_->name(), request_.session);
    if (resume) {
      progress_.scans_done = resume->next_scan();
      progress_.cells_done = resume->record.sequence + std::size_t{1};
      if (hooks_.progress) hooks_.progress(progress_);
      if (source_.size() > 0 && resume->next_scan() >= source_.size()) return;
    }
    Mapper mapper = make_mapper();
    if (!go_on_after(mapper, resume)) return;
    while (const auto scan = source_.next()) {
      throw_if_stopped(stop_);
      count_voxels(*scan);
      if (const auto update = mapper.add(*scan)) commit(*update);
      ++progress_.scans_done;
      if (hooks_.progress) hooks_.progress(progress_);
    }
    throw_if_stopped(stop_);
    if (const auto update = mapper.finish()) commit(*update);
  }

 private:
  Mapper make_mapper() const {
    // A change of the map that began before this job was running ends first; none begins after.
    const std::lock_guard lock(state_->writer());
    return Mapper(request_.options, request_.session, state_->lattice(), *state_->graph(),
                  MapState::targets(state_));
  }

  /// False where the drive ended before the stored part was read again.
  bool go_on_after(Mapper& mapper, const std::optional<ResumePoint>& resume) {
    if (!resume) return true;
    source_.seek(resume->cell->first_scan);
    const auto base_scan = source_.next();
    if (!base_scan) return false;
    mapper.resume_after(resume->record.id, resume->cell, *base_scan);
    source_.seek(resume->next_scan());
    return true;
  }

  void count_voxels(const PosedScan& scan) {
    if (voxels_.size() > kMaxVoxels) return;
    const Scan clean = filter_scan(scan.points, scan.stamp, request_.options.filter);
    voxels_.add(transformed(clean.points, scan.T_odom_sensor));
  }

  void commit(const CellUpdate& update) {
    MapUpdate map_update = to_map_update(update);
    map_update.voxel_points = earlier_voxels_ + voxels_.size();
    {
      const std::lock_guard lock(state_->writer());
      store_.commit(state_->name(), map_update);
    }
    ++progress_.cells_done;
    if (hooks_.committed) hooks_.committed(progress_);
  }

  Store& store_;
  std::shared_ptr<const MapState> state_;
  const IngestRequest& request_;
  ScanSource& source_;
  const std::stop_token& stop_;
  const IngestHooks& hooks_;
  std::uint64_t earlier_voxels_;
  VoxelCounter voxels_{kVoxelSize_m};
  Progress progress_;
};

}  // namespace

std::optional<ResumePoint> find_resume_point(const Store& store, const std::string& map,
                                             const std::string& session) {
  const auto record = store.last_cell(map, session);
  if (!record) return std::nullopt;
  return ResumePoint{*record, std::make_shared<const Cell>(load_cell(store, map, record->id))};
}

void run_ingest(Maps& maps, const std::string& map, const IngestRequest& request,
                ScanSource& source, const std::stop_token& stop, const IngestHooks& hooks) {
  Ingest(maps, map, request, source, stop, hooks).run();
}

}  // namespace cellmap::server
