#pragma once

#include <array>
#include <cstdint>

#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/place/ground.hpp"
#include "cellmap/place/place_signature.hpp"

namespace cellmap {

/// A PlaceSignature in whole steps, a quarter of its size: coefficients of 1/127 of the greatest
/// one, energies of 1/255. Of unit norm again. Agreements differ from those of the signature by one
/// or two thousandths.
class CompactSignature {
 public:
  explicit CompactSignature(const PlaceSignature& signature);

  /// The signature that the steps stand for.
  PlaceSignature expanded() const;
  /// PlaceSignature::most_alike of it, up to rounding.
  float most_alike(const simd::TurnedViews& views, std::size_t harmonics) const;

 private:
  PlaceSignature::Spectrum<std::int8_t> cosine_, sine_;
  std::array<std::uint8_t, PlaceSignature::kSectors> energy_;
  float step_ = 0, energy_step_ = 0;  // what one step stands for
};

/// What is kept of a CELL to find it by: what it looks like from its origin, upright on its ground.
/// 1.2 kB.
struct DescribedPlace {
  CompactSignature signature;
  Pose T_ground_cell = Pose::Identity();
};

/// `points`: of the CELL, in its frame. About 0.3 ms.
DescribedPlace describe_place(const PointCloud& points);

}  // namespace cellmap
