#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "cellmap/geometry/fibonacci_sphere.hpp"

namespace cellmap {

/// The lattice of the paper's released code: dense where a car's LiDAR sees the road, nothing above
/// where it sees no more than sky. Three Fibonacci spheres with their first and last points on the
/// poles, each cut to a band of heights:
///
///   band 0: -0.20 <= z < 0.70 of N points,  band 1: -0.60 <= z < -0.20 of 2 N points,
///   band 2: z < -0.60 of N / 200 points (rounded down)
///
/// numbered one after another. The axis of the spheres is y, not z: point (X, Y, Z) of a sphere is
/// the direction (x, y, z) = (X, Z, Y). So the directions of a band are not a range of the sphere's
/// indices; a bit for each says which are there (12 bytes for 64 of them), and there is a table of
/// those that are: 0.3 MB for N = 50,000.
///
/// How `nearest` is exact. Farther from the borders than the covering radius of a band's whole
/// sphere, the sphere's nearest point is in the band and nearer than every other band
/// (FibonacciSphere, vectorised). Nearer to a border, every direction around it is compared that
/// may be the nearest: with s the spacing of a band (a bound of its covering radius), a direction
/// outside it or at most s inside has its nearest one of the band at most 2 s inside, and one
/// inside has it within 2 s, for moving it inwards by at most s gives one that has a point of the
/// band within s. Band 2 is so coarse that all of it belongs to the border.
///
/// Immutable and safe to share between threads.
class FibonacciBands {
 public:
  /// `size` names N, 1,000 to 500,000. Takes about 1 ms for 50,000.
  explicit FibonacciBands(std::uint32_t size);

  /// The number of directions in all bands: 42,563 for N = 50,000.
  std::uint32_t size() const { return bands_.back().end(); }

  Eigen::Vector3d direction(std::uint32_t index) const;
  void directions(std::span<const std::uint32_t> indices, double* x, double* y, double* z) const;

  /// As Lattice::nearest.
  std::uint32_t nearest(const Eigen::Vector3d& direction) const;
  void nearest(const float* x, const float* y, const float* z,
               std::span<std::uint32_t> indices) const;

  /// Of the patches in the band of `index`.
  double patch_radius_rad(std::uint32_t index) const { return band_of(index).patch_radius_rad; }

 private:
  /// What is left of a sphere between two heights.
  class Band {
   public:
    Band(std::uint32_t sphere_size, double low, double high, std::uint32_t first);

    std::uint32_t end() const { return first + static_cast<std::uint32_t>(points.size()); }
    std::uint32_t index_of(std::uint32_t point) const;  ///< of a sphere's point in the band

    simd::FibonacciRings rings;
    double low, high;
    double patch_radius_rad;
    std::uint32_t first;                ///< index of its first direction in the lattice
    std::vector<std::uint32_t> points;  ///< the sphere's points that are in the band, increasing

   private:
    struct Members {
      std::uint64_t bits = 0;
      std::uint32_t before = 0;  ///< members among earlier points
    };
    std::vector<Members> members_;  ///< of 64 points each
  };

  /// Directions around the circle where two bands meet, by azimuth about z.
  struct Border {
    struct Candidate {
      double azimuth;
      Eigen::Vector3d point;  ///< frame of the sphere
      std::uint32_t index;
    };
    std::vector<Candidate> candidates;

    void add(const Band& band, double depth, double height);
    void sort();
    /// The nearest to the direction `point` (any length) of those within the chord.
    std::uint32_t nearest(const Eigen::Vector3d& point, double chord) const;
  };

  const Band& band_of(std::uint32_t index) const;
  std::uint32_t nearest_in_bottom(const Eigen::Vector3d& point, double norm, double height) const;

  std::array<Band, 3> bands_;
  std::array<FibonacciSphere, 2> spheres_;  ///< of bands 0 and 1
  Border top_, middle_, bottom_;            ///< at the heights 0.70, -0.20 and -0.60
  DirectionTable lowest_;                   ///< all of band 2, frame of the sphere
};

}  // namespace cellmap
