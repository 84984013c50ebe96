#include "cellmap/pipeline/front_end.hpp"

#include <utility>

namespace cellmap {
namespace {

constexpr double kVoxelSizeM = 0.4;  // the paper's comparison
constexpr std::size_t kMaxVoxels = 15'000'000;

}  // namespace

FinishedCell finished_without_scans(std::shared_ptr<const RegistrationTarget> target) {
  FinishedCell finished;
  finished.points = reconstruct_points(target->cell(), target->lattice());
  finished.target = std::move(target);
  return finished;
}

SessionVoxels::SessionVoxels() : counter_(kVoxelSizeM) {}

std::uint64_t SessionVoxels::add(std::span<const VoxelBlock> voxels) {
  const std::size_t before = counter_.size();
  if (before < kMaxVoxels) counter_.add(voxels);
  return counter_.size() - before;
}

FrontEnd::FrontEnd(MapperOptions options, std::string session,
                   std::shared_ptr<const Lattice> lattice)
    : options_(std::move(options)),
      session_(std::move(session)),
      lattice_(std::move(lattice)),
      voxels_(kVoxelSizeM) {
  options_.validate();
}

std::optional<FinishedCell> FrontEnd::add(const PosedScan& raw) {
  Scan scan = filter_scan(raw.points, raw.stamp, options_.filter);
  std::optional<FinishedCell> finished;
  if (local_map_ && local_map_->is_complete_for(raw.T_odom_sensor, options_.cell_distance_m)) {
    finished = make_cell();
    local_map_.reset();
  }
  voxels_.add(transformed(scan.points, raw.T_odom_sensor));
  if (local_map_) {
    local_map_->add(scan, raw.T_odom_sensor);
    raw_points_ += raw.points.size();
  } else {
    local_map_.emplace(std::move(scan), raw.T_odom_sensor, static_cast<std::uint32_t>(raw.index));
    builder_.emplace(*lattice_, options_.build);
    raw_points_ = raw.points.size();
  }
  builder_->update(*local_map_);
  return finished;
}

std::optional<FinishedCell> FrontEnd::finish() {
  if (!local_map_) return std::nullopt;
  FinishedCell finished = make_cell();
  local_map_.reset();
  return finished;
}

FinishedCell FrontEnd::make_cell() {
  Cell cell = builder_->finish(*local_map_);
  cell.session = session_;
  cell.sequence = next_sequence_++;
  FinishedCell finished;
  finished.target = std::make_shared<const RegistrationTarget>(
      std::make_shared<const Cell>(std::move(cell)), lattice_);
  finished.points = local_map_->base_scan().points;
  finished.scans = local_map_->scans();
  finished.raw_points = raw_points_;
  finished.voxels = voxels_.blocks();
  finished.voxel_points = session_voxels_.add(finished.voxels);
  voxels_.clear();
  return finished;
}

}  // namespace cellmap
