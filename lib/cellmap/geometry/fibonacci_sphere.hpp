#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/simd/directions.hpp"
#include "cellmap/simd/nearest.hpp"

namespace cellmap {

/// Directions of some points of a sphere.
struct DirectionTable {
  std::vector<double> x, y, z;

  DirectionTable() = default;
  DirectionTable(const simd::FibonacciRings& rings, std::span<const std::uint32_t> points)
      : x(points.size()), y(points.size()), z(points.size()) {
    simd::directions(rings, points.data(), points.size(), x.data(), y.data(), z.data());
  }
  Eigen::Vector3d operator[](std::size_t k) const { return {x[k], y[k], z[k]}; }
  simd::Directions view() const { return {x.data(), y.data(), z.data()}; }
};

/// N points spread evenly over the unit sphere, from the pole of the axis z downwards: the golden
/// angle from each to the next, equal steps in height. What lattices are made of (lattice.hpp).
///
///   z_i = (M - a) / M,  a = 2 i + o,  azimuth_i = 2 pi frac(i / phi),  phi = (1 + sqrt 5) / 2
///
/// with M = N and o = 1 where the first and the last point lie beside the poles, M = N - 1 and o =
/// 0 where they are the poles.
///
/// Every direction is computed from integers by IEEE double operations that round the same way
/// everywhere (+, -, *, /, sqrt, no fused multiply-add, no libm), so it has the same bits on every
/// machine:
///   f   = i * 0x9E3779B97F4A7C15 mod 2^64           frac(i / phi) in units of 2^-64 turn
///   z   = (M - a) / M                                the numerator is an exact integer
///   r   = sqrt(a (2 M - a)) / M                      radius of the circle of latitude
///   q   = (f + 2^61 mod 2^64) >> 62                  the nearest quarter turn
///   x   = int64(f - q 2^62) * (2 pi / 2^64)          the rest, |x| <= pi / 4
///   s,c = Taylor series of sin x to x^17 and cos x to x^16 by Horner's rule in x^2
///   (cos, sin) of the azimuth = (c, s), (-s, c), (-c, -s), (s, -c) for q = 0, 1, 2, 3
///   direction = (r cos, r sin, z)
/// The fixed-point golden ratio is off by less than N 2^-64 < 6e-14 turn.
///
/// How `nearest` is exact. In (index, azimuth) coordinates the points are a plane lattice, and in
/// the latitude zone k its steps by the Fibonacci numbers F_k and F_k+1 are a reduced basis: the
/// parallelogram of that basis that holds a direction splits into two triangles without an obtuse
/// angle, so the nearest point is one of its four corners (Keinert et al. 2015). That is exact on
/// the plane, where the corner of a Voronoi cell stays at least 0.3 basis steps away from the
/// border of the four parallelograms around its point; the sphere bends this by about the ratio of
/// point spacing to distance from the pole, and that is kept under 1/8 by handling the caps apart.
/// In a cap every point that may be as near as the best one is compared. Corners are compared by
/// their squared chords, which are good to 1e-15; those that come within 1e-13 of the best are
/// compared by the double dot products that define the answer. The tests hold this against brute
/// force and measure the 0.3 at every corner of every Voronoi cell.
///
/// Immutable and safe to share between threads.
class FibonacciSphere {
 public:
  enum class Ends { kBesidePoles, kOnPoles };

  /// 999 < size <= 1,000,000. Takes microseconds and 20 KB for any size: there is no table of all
  /// points.
  FibonacciSphere(std::uint32_t size, Ends ends);

  static simd::FibonacciRings rings(std::uint32_t size, Ends ends);
  static Eigen::Vector3d direction(const simd::FibonacciRings& rings, std::uint32_t index);

  std::uint32_t size() const { return size_; }
  const simd::FibonacciRings& rings() const { return rings_; }
  /// Side of the square that has a point's share of the sphere's area. No direction has a longer
  /// chord to its nearest point.
  double spacing() const;

  Eigen::Vector3d direction(std::uint32_t index) const { return direction(rings_, index); }
  void directions(std::span<const std::uint32_t> indices, double* x, double* y, double* z) const {
    simd::directions(rings_, indices.data(), indices.size(), x, y, z);
  }

  /// As Lattice::nearest.
  std::uint32_t nearest(const Eigen::Vector3d& direction) const;
  void nearest(const float* x, const float* y, const float* z,
               std::span<std::uint32_t> indices) const;

 private:
  /// Between two latitudes, the two index steps that make a reduced basis.
  struct Zone {
    double min_r2;                    ///< squared radius of the circle of latitude where it begins
    std::int64_t step_a, step_b;      ///< F_k and F_k+1
    double index_to_a, azimuth_to_a;  ///< coordinate a = index_to_a t + azimuth_to_a turns
    double index_to_b, azimuth_to_b;
  };

  const Zone& zone_at(double r2) const;
  std::uint32_t nearest_in_cap(const Eigen::Vector3d& direction, double unit_z, double r2) const;
  std::uint32_t nearest_in_zone(const Eigen::Vector3d& direction, double unit_z, double r2) const;

  simd::FibonacciZones vector_zones() const;

  std::uint32_t size_;
  simd::FibonacciRings rings_;
  double cap_r2_ = 0;             ///< nearer to the axis than this is in a cap
  std::vector<Zone> zones_;       ///< from the equator to the caps
  DirectionTable north_, south_;  ///< around the poles, from them outwards
  simd::FibonacciZones vector_zones_;
};

}  // namespace cellmap
