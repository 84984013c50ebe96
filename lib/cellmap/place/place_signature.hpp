#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// What stands upright, gathered in columns of 1 m: all that a signature needs, so that signatures
/// around many centres are quick. Points less than 0.3 m above the ground are left out.
class Columns {
 public:
  /// Of points in a ground frame (place/ground.hpp): z above the ground. Those within a square of
  /// kReachM to each side of the origin count.
  explicit Columns(const PointCloud& points);

  static constexpr double kReachM = 90.0;

  struct Column {
    float x, y;     ///< mean of its points
    float top_m;    ///< greatest height above the ground
    float upright;  ///< number of points
  };
  const std::vector<Column>& all() const { return columns_; }

 private:
  std::vector<Column> columns_;
};

/// What a place looks like from a point, whatever the heading. The surroundings to 80 m are cut
/// into 20 rings by 60 sectors; each bin has the greatest height and the logarithm of the number of
/// points of what stands in it. Over azimuth, each ring of both is expanded in a Fourier series up
/// to `kHarmonics`: a turn of the sensor changes the phases only. Magnitudes therefore find places
/// and phases tell the heading, at a fortieth of the cost of turning images. 4.2 KB; about 0.1 ms
/// for 5,000 columns.
class PlaceSignature {
 public:
  static constexpr std::size_t kRings = 20;
  static constexpr std::size_t kRows = 2 * kRings;  ///< heights, then counts
  static constexpr std::size_t kSectors = 60;
  static constexpr double kMaxRangeM = 80.0;
  static constexpr std::size_t kHarmonics = 12;
  /// The key has the magnitudes of the harmonics 0 to kKeyHarmonics of every row.
  static constexpr std::size_t kKeyHarmonics = 5;
  static constexpr std::size_t kKeySize = kRows * (kKeyHarmonics + 1);

  using Key = Eigen::Matrix<float, kKeySize, 1>;
  using Correlation = Eigen::Matrix<float, kSectors, 1>;

  /// Seen from `centre` in the columns' frame.
  explicit PlaceSignature(const Columns& columns,
                          const Eigen::Vector2d& centre = Eigen::Vector2d::Zero());

  /// Unit vector; the product of two keys says how alike two places are, in [-1, 1].
  Key key() const;

  /// Agreement in [-1, 1] with `other` turned by each of the kSectors shifts: entry k belongs to
  /// other's points turned by +k * 6 deg about z. About 1 us.
  Correlation correlate(const PlaceSignature& other) const;

 private:
  using Coefficients = Eigen::Matrix<float, kRows, kHarmonics + 1>;
  Coefficients cosine_, sine_;  // of each row and harmonic; together of unit norm
};

}  // namespace cellmap
