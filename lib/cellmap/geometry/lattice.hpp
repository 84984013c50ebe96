#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/simd/nearest.hpp"

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
/// Every direction is computed from integers by IEEE double operations that round the same way
/// everywhere (+, -, *, /, sqrt, no fused multiply-add, no libm), so it has the same bits on every
/// machine:
///   f   = i * 0x9E3779B97F4A7C15 mod 2^64           frac(i / phi) in units of 2^-64 turn
///   z   = (N - 2 i - 1) / N                          the numerator is an exact integer
///   r   = sqrt((2 i + 1) (2 N - 2 i - 1)) / N        radius of the circle of latitude
///   q   = (f + 2^61 mod 2^64) >> 62                  the nearest quarter turn
///   x   = int64(f - q 2^62) * (2 pi / 2^64)          the rest, |x| <= pi / 4
///   s,c = Taylor series of sin x to x^17 and cos x to x^16 by Horner's rule in x^2
///   (cos, sin) of the azimuth = (c, s), (-s, c), (-c, -s), (s, -c) for q = 0, 1, 2, 3
///   direction = (r cos, r sin, z)
/// The fixed-point golden ratio is off by less than N 2^-64 < 6e-14 turn.
///
/// How `nearest` is exact. In (index, azimuth) coordinates the lattice is a plane lattice, and in
/// the latitude zone k its steps by the Fibonacci numbers F_k and F_k+1 are a reduced basis: the
/// parallelogram of that basis that holds a direction splits into two triangles without an obtuse
/// angle, so the nearest lattice point is one of its four corners (Keinert et al. 2015). That is
/// exact on the plane, where the corner of a Voronoi cell stays at least 0.3 basis steps away from
/// the border of the four parallelograms around its lattice point; the sphere bends this by about
/// the ratio of point spacing to distance from the pole, and that is kept under 1/8 by handling
/// the caps apart. In a cap every lattice point that may be as near as the best one is compared.
/// Corners are compared by their squared chords, which are good to 1e-15; those that come within
/// 1e-13 of the best are compared by the double dot products that define the answer. The tests
/// hold this against brute force and measure the 0.3 at every corner of every Voronoi cell.
///
/// Immutable and safe to share between threads.
class Lattice {
 public:
  /// Validates the spec. Takes microseconds and 20 KB for any N: there is no table of all points.
  explicit Lattice(const LatticeSpec& spec);

  const LatticeSpec& spec() const { return spec_; }
  std::uint32_t size() const { return spec_.size; }

  /// Unit direction of lattice point `index` < size().
  Eigen::Vector3d direction(std::uint32_t index) const;

  /// The lattice point nearest to a direction of any length > 0: the argmax over all i of
  /// direction(i) . direction, evaluated in double (x x + y y + z z from left to right); the lower
  /// index on a tie. Constant time.
  std::uint32_t nearest(const Eigen::Vector3d& direction) const;

  /// The same of every point of `cloud`, written to `indices` (same length); `kNowhere` for points
  /// that are not finite or the origin. Vectorised (simd/nearest.hpp): decided in float where that
  /// is certain, else as above, so the same on every machine. Serial; callers that want threads
  /// split the points.
  void nearest(const PointCloud& cloud, std::span<std::uint32_t> indices) const;
  void nearest(const float* x, const float* y, const float* z,
               std::span<std::uint32_t> indices) const;
  static constexpr std::uint32_t kNowhere = simd::kUndecided;

  /// Mean angular radius of a patch: the radius of a disc that has the patch's mean solid angle,
  /// 2 / sqrt(N) rad.
  double patch_radius_rad() const;

 private:
  /// Between two latitudes, the two index steps that make a reduced basis of the lattice.
  struct Zone {
    double min_r2;                    ///< squared radius of the circle of latitude where it begins
    std::int64_t step_a, step_b;      ///< F_k and F_k+1
    double index_to_a, azimuth_to_a;  ///< lattice coordinate a = index_to_a t + azimuth_to_a turns
    double index_to_b, azimuth_to_b;
  };

  /// Directions around a pole, from the pole outwards.
  struct Cap {
    std::vector<double> x, y, z;
    void push_back(const Eigen::Vector3d& direction);
    simd::Directions view() const { return {x.data(), y.data(), z.data()}; }
  };

  const Zone& zone_at(double r2) const;
  std::uint32_t nearest_in_cap(const Eigen::Vector3d& direction, double unit_z, double r2) const;
  std::uint32_t nearest_in_zone(const Eigen::Vector3d& direction, double unit_z, double r2) const;

  simd::FibonacciZones vector_zones() const;

  LatticeSpec spec_;
  double cap_r2_ = 0;        ///< nearer to the axis than this is in a cap
  std::vector<Zone> zones_;  ///< from the equator to the caps
  Cap north_, south_;
  simd::FibonacciZones vector_zones_;
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
