#pragma once

#include <map>
#include <string>
#include <vector>

#include "cellmap/archive/archive_writer.hpp"
#include "codec/samples.hpp"

namespace cellmap::test {

/// A small map with everything that an archive can hold.
struct ArchiveSample {
  std::vector<Cell> cells;  ///< CELL k has the id `ids[k]`
  std::vector<CellId> ids;
  ArchiveContents contents;

  explicit ArchiveSample(std::uint32_t count, std::uint32_t planes = 40) {
    contents.map = "town";
    contents.created = 1'700'000'000'123'456'789;
    contents.sessions = {{"monday", "robot 7", "OS1-64", "robot7/odom", 1'690'000'000'000'000'000},
                         {"tuesday", "", "", "", 0}};
    Georeference georeference{49.0, 8.4, 116.0, Eigen::Matrix3d::Identity()};
    georeference.R_enu_map = Eigen::AngleAxisd(0.3, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    contents.georeference = georeference;
    contents.graph.revision = 17;
    for (std::uint32_t k = 0; k < count; ++k) add(k, planes);
    for (std::uint32_t k = 1; k < count; ++k) tie(k);
  }

  /// The archive's bytes.
  Bytes bytes(const ArchiveOptions& options = {}) const {
    MemoryFile file;
    ArchiveWriter writer(file, cells.empty() ? LatticeSpec{} : cells.front().lattice, options);
    for (std::size_t k = 0; k < cells.size(); ++k) writer.add(ids[k], cells[k]);
    writer.finish(contents);
    return file.bytes();
  }

 private:
  void add(std::uint32_t k, std::uint32_t planes) {
    std::mt19937 rng(k);
    Cell cell = random_cell(k, planes, 1000);
    cell.session = k % 3 == 2 ? "tuesday" : "monday";
    cell.sequence = k;
    cell.first_stamp += Stamp{k} * 1'000'000'000;
    cell.last_stamp += Stamp{k} * 1'000'000'000;
    const CellId id{2 * k + 1};
    contents.graph.nodes[id] = random_pose(rng);
    if (k % 3 == 2) contents.graph.unaligned.insert(id);
    CellScans stretch;
    stretch.cell = id;
    stretch.T_odom_cell = cell.T_odom_cell;
    stretch.raw_points = 100'000 + k;
    stretch.voxel_points = 500 + k;
    for (int i = 0; i < 3; ++i) {
      stretch.scans.push_back({cell.first_stamp + i * 100'000'000, random_pose(rng)});
    }
    contents.stretches[id] = stretch;
    cells.push_back(std::move(cell));
    ids.push_back(id);
  }

  void tie(std::uint32_t k) {
    std::mt19937 rng(1000 + k);
    Constraint constraint;
    constraint.id = ConstraintId{3 * k};
    constraint.from = ids[k - 1];
    constraint.to = ids[k];
    constraint.T_from_to = random_pose(rng);
    constraint.information = Matrix6d::Identity() * (k + 0.1);
    constraint.kind = k % 2 ? ConstraintKind::kBidirectional : ConstraintKind::kLoop;
    constraint.weight = 1.0 / k;
    constraint.pinned = k % 4 == 0;
    contents.graph.constraints.push_back(constraint);
  }
};

}  // namespace cellmap::test
