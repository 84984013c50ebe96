#include "cellmap/pipeline/mapper.hpp"

#include "cellmap/core/error.hpp"

namespace cellmap {

FinishedCell last_of_session(std::shared_ptr<const Cell> last, const PosedScan& base_scan,
                             std::shared_ptr<const Lattice> lattice,
                             const ScanFilterOptions& filter) {
  if (base_scan.index != last->first_scan) {
    throw Error(ErrorCode::kInvalidArgument, "to resume, scan " + std::to_string(last->first_scan) +
                                                 " of the drive was expected, found scan " +
                                                 std::to_string(base_scan.index));
  }
  FinishedCell cell;
  cell.target = std::make_shared<const RegistrationTarget>(std::move(last), std::move(lattice));
  cell.points = filter_scan(base_scan.points, base_scan.stamp, filter).points;
  return cell;
}

Mapper::Mapper(MapperOptions options, std::string session, std::shared_ptr<const Lattice> lattice,
               PoseGraph graph, MapAccess access)
    : options_(std::move(options)),
      lattice_(std::move(lattice)),
      graph_(std::move(graph)),
      front_end_(options_, std::move(session), lattice_),
      back_end_(options_, std::move(access)) {}

void Mapper::resume_after(CellId id, std::shared_ptr<const Cell> last, const PosedScan& base_scan) {
  if (!graph_.nodes.contains(id)) {
    throw Error(ErrorCode::kInvalidArgument,
                "to resume, CELL " + std::to_string(id.value) + " must be in the pose graph");
  }
  FinishedCell cell = last_of_session(std::move(last), base_scan, lattice_, options_.filter);
  front_end_.resume_after(cell.cell());
  back_end_.resume_after(id, std::move(cell));
}

std::optional<CellUpdate> Mapper::add(const PosedScan& scan) {
  auto finished = front_end_.add(scan);
  if (!finished) return std::nullopt;
  return integrate(std::move(*finished));
}

std::optional<CellUpdate> Mapper::finish() {
  auto finished = front_end_.finish();
  if (!finished) return std::nullopt;
  return integrate(std::move(*finished));
}

CellUpdate Mapper::integrate(FinishedCell&& cell) {
  if (become_) {
    cell.target =
        std::make_shared<const RegistrationTarget>(become_({cell.target, &cell.cell()}), lattice_);
  }
  return back_end_.integrate(std::move(cell), graph_);
}

void Mapper::number(std::span<const ConstraintId> ids) {
  if (ids.size() > graph_.constraints.size()) {
    throw Error(ErrorCode::kInvalidArgument, "more ids than there are constraints");
  }
  std::size_t next = graph_.constraints.size() - ids.size();
  for (const ConstraintId id : ids) graph_.constraints[next++].id = id;
}

}  // namespace cellmap
