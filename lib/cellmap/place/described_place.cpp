#include "cellmap/place/described_place.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace cellmap {
namespace {

constexpr float kMostSteps = 127.0f, kMostEnergySteps = 255.0f;

float inverse_or_zero(float value) { return value > 0 ? 1 / value : 0.0f; }

}  // namespace

CompactSignature::CompactSignature(const PlaceSignature& signature) {
  const auto& cosine = signature.cosine();
  const auto& sine = signature.sine();
  const float greatest = std::max(cosine.cwiseAbs().maxCoeff(), sine.cwiseAbs().maxCoeff());
  const float steps = kMostSteps * inverse_or_zero(greatest);
  cosine_ = (steps * cosine).array().round().cast<std::int8_t>();
  sine_ = (steps * sine).array().round().cast<std::int8_t>();
  step_ = inverse_or_zero(
      std::sqrt(cosine_.cast<float>().squaredNorm() + sine_.cast<float>().squaredNorm()));

  const auto& energy = signature.energy();
  const float energy_steps =
      kMostEnergySteps * inverse_or_zero(*std::max_element(energy.begin(), energy.end()));
  for (std::size_t s = 0; s < energy.size(); ++s) {
    energy_[s] = static_cast<std::uint8_t>(std::round(energy_steps * energy[s]));
  }
  energy_step_ = inverse_or_zero(std::accumulate(energy_.begin(), energy_.end(), 0.0f));
}

PlaceSignature CompactSignature::expanded() const {
  std::array<float, PlaceSignature::kSectors> energy;
  for (std::size_t s = 0; s < energy.size(); ++s) energy[s] = energy_step_ * energy_[s];
  return {step_ * cosine_.cast<float>(), step_ * sine_.cast<float>(), energy};
}

float CompactSignature::most_alike(const simd::TurnedViews& views, std::size_t harmonics) const {
  std::array<float, PlaceSignature::kRows*(PlaceSignature::kHarmonics + 1)> cosine, sine;
  const std::size_t count = harmonics * PlaceSignature::kRows;
  for (std::size_t i = 0; i < count; ++i) cosine[i] = cosine_.data()[i];
  for (std::size_t i = 0; i < count; ++i) sine[i] = sine_.data()[i];
  return step_ * simd::best_turned(views, cosine.data(), sine.data(), harmonics);
}

DescribedPlace describe_place(const PointCloud& points) {
  const Pose T_ground_cell = fit_ground(points).T_ground_sensor;
  return {CompactSignature(PlaceSignature(Columns(transformed(points, T_ground_cell)))),
          T_ground_cell};
}

}  // namespace cellmap
