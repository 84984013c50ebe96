#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "cellmap/geometry/point_cloud.hpp"
#include "cellmap/place/ground.hpp"
#include "cellmap/place/place_signature.hpp"

namespace cellmap {

/// A PlaceSignature in whole steps, a quarter of its size: coefficients of 1/127 of the greatest
/// one, energies of 1/255. Of unit norm again. Agreements differ from those of the signature by one
/// or two thousandths.
class CompactSignature {
 public:
  static constexpr std::size_t kCoefficients =
      PlaceSignature::kRows * (PlaceSignature::kHarmonics + 1);
  struct Steps {
    std::array<std::int8_t, kCoefficients> cosine{}, sine{};  ///< harmonic by harmonic
    std::array<std::uint8_t, PlaceSignature::kSectors> energy{};
  };

  explicit CompactSignature(const PlaceSignature& signature);
  explicit CompactSignature(const Steps& steps);

  const Steps& steps() const { return steps_; }
  /// The signature that the steps stand for.
  PlaceSignature expanded() const;
  /// PlaceSignature::most_alike of it, up to rounding.
  float most_alike(const simd::TurnedViews& views, std::size_t harmonics) const;

 private:
  Steps steps_;
  float step_ = 0, energy_step_ = 0;  // what one stands for
};

/// What is kept of a CELL to find it by: what it looks like from its origin, upright on its ground.
/// 1.2 kB.
struct DescribedPlace {
  CompactSignature signature;
  Pose T_ground_cell = Pose::Identity();
};

/// `points`: of the CELL, in its frame. About 0.3 ms.
DescribedPlace describe_place(const PointCloud& points);

/// Bytes of a description, kDescribedPlaceBytes, in a form that is this program's own; and what
/// such bytes describe: nullopt where they were written in another form or can mean nothing, so
/// that the CELL is to be described anew.
constexpr std::size_t kDescribedPlaceBytes =
    1 + sizeof(CompactSignature::Steps) + 12 * sizeof(double);
std::vector<std::byte> to_bytes(const DescribedPlace& place);
std::optional<DescribedPlace> described_place_from_bytes(std::span<const std::byte> bytes);

}  // namespace cellmap
