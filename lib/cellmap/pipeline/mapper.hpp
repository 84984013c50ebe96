#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "cellmap/pipeline/back_end.hpp"
#include "cellmap/pipeline/front_end.hpp"
#include "cellmap/pipeline/mapper_options.hpp"

namespace cellmap {

/// The online pipeline (paper, Sec. III-A) of one session that has the map to itself: scans with
/// odometry in, CELLs with constraints and poses out. Holds the pose graph, the current local map
/// and the previous base scan, never the scans of the past. One owner.
class Mapper {
 public:
  /// `graph` is the map as it stands (empty for a new one); `access` hands out its CELLs.
  Mapper(MapperOptions options, std::string session, std::shared_ptr<const Lattice> lattice,
         PoseGraph graph, MapAccess access);

  /// Continues a session after its last stored CELL. `base_scan` is the (unfiltered) scan
  /// `last.first_scan` of the drive. The next scan to add is `last.first_scan + last.scan_count`.
  void resume_after(CellId id, std::shared_ptr<const Cell> last, const PosedScan& base_scan);

  /// Adds the next scan; returns the CELL that it completed, if it did.
  std::optional<CellUpdate> add(const PosedScan& scan);

  /// The two halves of `add`, for who runs them side by side (`make_cells`): scans into finished
  /// CELLs, and a finished CELL into the map.
  FrontEnd& front_end() { return front_end_; }
  CellUpdate integrate(FinishedCell&& cell);

  /// Ends the drive: the CELL of the scans since the last one, if there are any.
  std::optional<CellUpdate> finish();

  /// What a finished CELL becomes before anything is made of it, for a map that keeps its CELLs in
  /// fewer bits: constraints are then those of the CELLs that are kept. Empty: nothing.
  void on_finished(std::function<std::shared_ptr<const Cell>(std::shared_ptr<const Cell>)> become) {
    become_ = std::move(become);
  }

  /// Tells the ids that a store gave to the constraints of the last update, in order: only numbered
  /// constraints are told when they are judged otherwise later.
  void number(std::span<const ConstraintId> ids);

  const PoseGraph& graph() const { return graph_; }
  const MapperOptions& options() const { return options_; }

 private:
  MapperOptions options_;
  std::shared_ptr<const Lattice> lattice_;
  PoseGraph graph_;
  FrontEnd front_end_;
  BackEnd back_end_;
  std::function<std::shared_ptr<const Cell>(std::shared_ptr<const Cell>)> become_;
};

/// A stored CELL as the back end goes on from it. Throws Error{kInvalidArgument} where `base_scan`
/// is not the scan `last.first_scan` of the drive.
FinishedCell last_of_session(std::shared_ptr<const Cell> last, const PosedScan& base_scan,
                             std::shared_ptr<const Lattice> lattice,
                             const ScanFilterOptions& filter);

}  // namespace cellmap
