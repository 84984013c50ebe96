#include "cellmap/place/described_place.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace cellmap {
namespace {

constexpr float kMostSteps = 127.0f, kMostEnergySteps = 255.0f;
/// To be raised with every change of what `describe_place` makes of a CELL.
constexpr std::byte kForm{1};

using Steps = CompactSignature::Steps;
using RigidRows = Eigen::Matrix<double, 3, 4, Eigen::RowMajor>;
static_assert(std::endian::native == std::endian::little, "bytes of a description");
static_assert(sizeof(Steps) == 2 * CompactSignature::kCoefficients + PlaceSignature::kSectors);
static_assert(kDescribedPlaceBytes == 1 + sizeof(Steps) + sizeof(RigidRows));

float inverse_or_zero(float value) { return value > 0 ? 1 / value : 0.0f; }

Steps steps_of(const PlaceSignature& signature) {
  Steps steps;
  const auto& cosine = signature.cosine();
  const auto& sine = signature.sine();
  const float scale = kMostSteps * inverse_or_zero(std::max(cosine.cwiseAbs().maxCoeff(),
                                                            sine.cwiseAbs().maxCoeff()));
  for (std::size_t i = 0; i < steps.cosine.size(); ++i) {
    steps.cosine[i] = static_cast<std::int8_t>(std::round(scale * cosine.data()[i]));
    steps.sine[i] = static_cast<std::int8_t>(std::round(scale * sine.data()[i]));
  }
  const auto& energy = signature.energy();
  const float energy_scale =
      kMostEnergySteps * inverse_or_zero(*std::max_element(energy.begin(), energy.end()));
  for (std::size_t s = 0; s < energy.size(); ++s) {
    steps.energy[s] = static_cast<std::uint8_t>(std::round(energy_scale * energy[s]));
  }
  return steps;
}

}  // namespace

CompactSignature::CompactSignature(const PlaceSignature& signature)
    : CompactSignature(steps_of(signature)) {}

CompactSignature::CompactSignature(const Steps& steps) : steps_(steps) {
  float squared = 0, energy = 0;  // sums of small integers: exact
  for (const std::int8_t c : steps_.cosine) squared += static_cast<float>(c * c);
  for (const std::int8_t s : steps_.sine) squared += static_cast<float>(s * s);
  for (const std::uint8_t e : steps_.energy) energy += e;
  step_ = inverse_or_zero(std::sqrt(squared));
  energy_step_ = inverse_or_zero(energy);
}

PlaceSignature CompactSignature::expanded() const {
  PlaceSignature::Spectrum<float> cosine, sine;
  std::array<float, PlaceSignature::kSectors> energy;
  for (std::size_t i = 0; i < kCoefficients; ++i) {
    cosine.data()[i] = step_ * steps_.cosine[i];
    sine.data()[i] = step_ * steps_.sine[i];
  }
  for (std::size_t s = 0; s < energy.size(); ++s) energy[s] = energy_step_ * steps_.energy[s];
  return {cosine, sine, energy};
}

float CompactSignature::most_alike(const simd::TurnedViews& views, std::size_t harmonics) const {
  std::array<float, kCoefficients> cosine, sine;
  const std::size_t count = harmonics * PlaceSignature::kRows;
  for (std::size_t i = 0; i < count; ++i) cosine[i] = steps_.cosine[i];
  for (std::size_t i = 0; i < count; ++i) sine[i] = steps_.sine[i];
  return step_ * simd::best_turned(views, cosine.data(), sine.data(), harmonics);
}

DescribedPlace describe_place(const PointCloud& points) {
  const Pose T_ground_cell = fit_ground(points).T_ground_sensor;
  return {CompactSignature(PlaceSignature(Columns(transformed(points, T_ground_cell)))),
          T_ground_cell};
}

std::vector<std::byte> to_bytes(const DescribedPlace& place) {
  const RigidRows T = place.T_ground_cell.matrix().topRows<3>();
  std::vector<std::byte> bytes(kDescribedPlaceBytes);
  bytes[0] = kForm;
  std::memcpy(&bytes[1], &place.signature.steps(), sizeof(Steps));
  std::memcpy(&bytes[1 + sizeof(Steps)], T.data(), sizeof(RigidRows));
  return bytes;
}

std::optional<DescribedPlace> described_place_from_bytes(std::span<const std::byte> bytes) {
  if (bytes.size() != kDescribedPlaceBytes || bytes[0] != kForm) return std::nullopt;
  Steps steps;
  RigidRows rows;
  std::memcpy(&steps, &bytes[1], sizeof(Steps));
  std::memcpy(rows.data(), &bytes[1 + sizeof(Steps)], sizeof(RigidRows));
  DescribedPlace place{CompactSignature(steps)};
  place.T_ground_cell.matrix().topRows<3>() = rows;
  if (!is_rigid(place.T_ground_cell)) return std::nullopt;
  return place;
}

}  // namespace cellmap
