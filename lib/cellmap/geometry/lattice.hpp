#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include <Eigen/Core>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// Which lattice a CELL was made with; part of the file format (FORMAT.md, "Lattices"), so values
/// are never reused and an order, once published, never changes.
enum class LatticeKind : std::uint8_t {
  kFibonacci = 1,
};

/// Names one lattice exactly. Two equal specs give the same directions in the same order on every
/// machine.
struct LatticeSpec {
  LatticeKind kind = LatticeKind::kFibonacci;
  std::uint32_t size = 50'000;  ///< number of lattice points, 1,000 to 1,000,000
  bool operator==(const LatticeSpec&) const = default;

  /// Throws Error{kUnsupported} for a kind or a size this build does not know.
  void validate() const;
};

/// For example "fibonacci-50000".
std::string to_string(const LatticeSpec& spec);

/// A fixed set of nearly uniform directions on the unit sphere. Each lattice point owns the patch
/// of directions that are nearer to it than to any other.
///
/// Fibonacci lattice of N points (the paper's FL, Sec. III-B; order fixed by FORMAT.md):
///   z_i = 1 - (2 i + 1) / N,  azimuth_i = 2 pi frac(i / phi),  phi = (1 + sqrt 5) / 2.
///
/// Immutable and safe to share between threads.
class Lattice {
 public:
  /// Validates the spec. Building takes about a millisecond for 50,000 points.
  explicit Lattice(const LatticeSpec& spec);

  const LatticeSpec& spec() const { return spec_; }
  std::uint32_t size() const { return spec_.size; }

  /// Unit direction of lattice point `index` < size().
  Eigen::Vector3d direction(std::uint32_t index) const;

  /// The lattice point nearest to a direction of any length > 0: the argmax over all i of
  /// direction(i) . direction, evaluated in double; the lower index on a tie. Constant time.
  std::uint32_t nearest(const Eigen::Vector3d& direction) const;

  /// `nearest` of every point of `cloud`, written to `indices` (same length). Points must be finite
  /// and not the origin. Serial; callers that want threads split the cloud.
  void nearest(const PointCloud& cloud, std::span<std::uint32_t> indices) const;

  /// Mean angular radius of a patch: the radius of a disc that has the patch's mean solid angle,
  /// 2 / sqrt(N) rad.
  double patch_radius_rad() const;

 private:
  LatticeSpec spec_;
  // The owner of this room replaces this with what the lookup needs.
};

/// One immutable lattice per spec, built on first use and shared afterwards; the cache is a value,
/// owned by whoever needs it (a store reader, a server). Thread safe.
class LatticeCache {
 public:
  LatticeCache();
  ~LatticeCache();
  std::shared_ptr<const Lattice> get(const LatticeSpec& spec);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
