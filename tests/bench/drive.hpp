#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "cellmap/cell/local_map.hpp"
#include "cellmap/registration/registration.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "cellmap/simulation/simulator.hpp"

namespace cellmap::bench {

/// What the table calls the data; simulated data says so.
constexpr const char* kSimulated = "simulated town";
constexpr const char* kKitti = "kitti00-consecutive";
constexpr const char* kKittiDense = "kitti00-dense";

/// A drive held in memory.
class MemorySource : public ScanSource {
 public:
  explicit MemorySource(const std::vector<PosedScan>& scans) : scans_(scans) {}

  std::size_t size() const override { return scans_.size(); }
  std::optional<PosedScan> next() override {
    if (position_ == scans_.size()) return std::nullopt;
    return scans_[position_++];
  }
  void seek(std::size_t index) override { position_ = index; }
  const Trajectory& ground_truth() const override { return no_truth_; }

 private:
  const std::vector<PosedScan>& scans_;
  std::size_t position_ = 0;
  Trajectory no_truth_;
};

/// Some scans of the simulated town with their true poses, numbered from 0.
std::vector<PosedScan> simulated_scans(std::size_t first, std::size_t count);

/// The 16 scans of `kKitti`; empty where the data is not there.
std::vector<PosedScan> kitti_scans();

/// A CELL of `kKittiDense` whose patches were tested strictly (0.2 m between ranges, 12 points), so
/// that about 5,800 planes are left; none where the data is not there.
std::optional<Cell> strict_kitti_cell(const Lattice& lattice);

/// KITTI 00's ground truth, which need not be there.
std::filesystem::path kitti00_route();

/// Splits a drive as the mapper does: a new local map beyond 6 m. Only full ones, except where
/// `keep_last`.
std::vector<LocalMap> local_maps(const std::vector<PosedScan>& scans, bool keep_last);

/// Two neighbouring CELLs with their base scans.
struct CellPair {
  std::string data;
  std::shared_ptr<const Lattice> lattice;
  LocalMap local_map_a, local_map_b;
  RegistrationTarget a, b;
  Pose T_a_b;  ///< from the poses of the scans

  const PointCloud& scan_a() const { return local_map_a.base_scan().points; }
  const PointCloud& scan_b() const { return local_map_b.base_scan().points; }
  /// 0.3 m and 1 deg off.
  Pose guess() const;
};

CellPair make_pair(const std::string& data, const std::vector<PosedScan>& scans,
                   std::shared_ptr<const Lattice> lattice);

RegistrationTarget to_target(const LocalMap& local_map, std::shared_ptr<const Lattice> lattice,
                             const std::string& session, std::uint32_t sequence);

}  // namespace cellmap::bench
