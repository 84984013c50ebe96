#include "cellmap/place/place_signature.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace cellmap {
namespace {

constexpr std::size_t kRings = PlaceSignature::kRings, kSectors = PlaceSignature::kSectors;
constexpr std::size_t kHarmonics = PlaceSignature::kHarmonics;
constexpr double kMaxRangeM = PlaceSignature::kMaxRangeM;
/// Heights above the ground that are told apart. The ground itself looks the same everywhere, and
/// how far it is seen depends on what is parked there.
constexpr float kLowestM = 0.3f, kHighestM = 8.0f;
constexpr float kFiner = 0.7f;

using Image = Eigen::Matrix<float, PlaceSignature::kRows, kSectors>;
/// Values of the harmonics at the sectors: column k, row s.
using Waves = Eigen::Matrix<float, kSectors, kHarmonics + 1>;

/// cos(x) for |x| <= pi, to a millionth of a millionth; std::cos is no constant expression.
constexpr double cosine_of(double x) {
  double term = 1, sum = 1;
  for (int n = 1; n <= 15; ++n) sum += term *= -x * x / ((2 * n - 1) * (2 * n));
  return sum;
}

/// cos and sin of k s 2 pi / kSectors: harmonic k in column k.
struct Tables {
  std::array<float, kSectors*(kHarmonics + 1)> cosine{}, sine{};
};
constexpr Tables make_tables() {
  std::array<float, kSectors> wave{};
  for (std::size_t s = 0; s < kSectors; ++s) {
    const double turn = static_cast<double>(s) / kSectors;
    const double angle = 2 * std::numbers::pi * (turn > 0.5 ? turn - 1 : turn);
    wave[s] = static_cast<float>(cosine_of(angle));
  }
  Tables tables;
  for (std::size_t k = 0; k <= kHarmonics; ++k) {
    for (std::size_t s = 0; s < kSectors; ++s) {
      tables.cosine[k * kSectors + s] = wave[k * s % kSectors];
      tables.sine[k * kSectors + s] = wave[(k * s + kSectors - kSectors / 4) % kSectors];
    }
  }
  return tables;
}
constexpr Tables kTables = make_tables();

Eigen::Map<const Waves> cosines() { return Eigen::Map<const Waves>(kTables.cosine.data()); }
Eigen::Map<const Waves> sines() { return Eigen::Map<const Waves>(kTables.sine.data()); }

/// Mean 0 and squared norm 1/2, so that neither heights nor counts outweigh the other.
template <typename Block>
void normalise(Block&& values) {
  values.array() -= values.mean();
  const float norm = values.norm();
  if (norm > 0) values *= std::sqrt(0.5f) / norm;
}

Image image_of(const Columns& columns, const Eigen::Vector2d& centre) {
  Image image = Image::Zero();
  for (const Columns::Column& column : columns.all()) {
    const float x = column.x - static_cast<float>(centre.x());
    const float y = column.y - static_cast<float>(centre.y());
    const float range = std::sqrt(x * x + y * y);
    if (!(range < static_cast<float>(kMaxRangeM))) continue;
    // Rings are finer where more is to be seen: 1.1 m wide nearby, 5.6 m at the rim.
    const float outwards = std::pow(range / static_cast<float>(kMaxRangeM), kFiner);
    const auto ring = std::min(static_cast<std::size_t>(outwards * kRings), kRings - 1);
    const float turn = std::atan2(y, x) * (0.5f / std::numbers::pi_v<float>)+0.5f;
    const auto sector = std::min(static_cast<std::size_t>(turn * kSectors), kSectors - 1);
    image(ring, sector) =
        std::max(image(ring, sector), std::clamp(column.top_m, kLowestM, kHighestM) - kLowestM);
    image(kRings + ring, sector) += column.upright;
  }
  image.bottomRows<kRings>() = image.bottomRows<kRings>().array().log1p();
  normalise(image.topRows<kRings>());
  normalise(image.bottomRows<kRings>());
  return image;
}

}  // namespace

Columns::Columns(const PointCloud& points) {
  constexpr auto kReach = static_cast<float>(kReachM);
  constexpr auto kSide = static_cast<std::size_t>(2 * kReachM);
  std::vector<std::uint32_t> column_of(kSide * kSide, 0);  // position plus 1
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float x = points.x[i], y = points.y[i];
    if (!(std::abs(x) < kReach && std::abs(y) < kReach && points.z[i] > kLowestM)) continue;
    const std::size_t square =
        static_cast<std::size_t>(y + kReach) * kSide + static_cast<std::size_t>(x + kReach);
    if (column_of[square] == 0) {
      columns_.push_back({0, 0, 0, 0});
      column_of[square] = static_cast<std::uint32_t>(columns_.size());
    }
    Column& column = columns_[column_of[square] - 1];
    column.x += x;
    column.y += y;
    column.top_m = std::max(column.top_m, points.z[i]);
    column.upright += 1;
  }
  for (Column& column : columns_) {
    column.x /= column.upright;
    column.y /= column.upright;
  }
}

PlaceSignature::PlaceSignature(const Columns& columns, const Eigen::Vector2d& centre) {
  const Image image = image_of(columns, centre);
  cosine_.noalias() = image * cosines();
  sine_.noalias() = image * sines();
  // Every harmonic but the mean stands for two coefficients of the whole spectrum.
  cosine_.rightCols<kHarmonics>() *= std::sqrt(2.0f);
  sine_.rightCols<kHarmonics>() *= std::sqrt(2.0f);
  const float norm = std::sqrt(cosine_.squaredNorm() + sine_.squaredNorm());
  if (norm > 0) {
    cosine_ /= norm;
    sine_ /= norm;
  }
}

PlaceSignature::Key PlaceSignature::key() const {
  Key key;
  Eigen::Map<Eigen::Matrix<float, kRows, kKeyHarmonics + 1>> rows(key.data());
  rows = (cosine_.leftCols<kKeyHarmonics + 1>().array().square() +
          sine_.leftCols<kKeyHarmonics + 1>().array().square())
             .sqrt();
  rows.col(0) = cosine_.col(0);  // means have a sign
  const float norm = key.norm();
  if (norm > 0) key /= norm;
  return key;
}

PlaceSignature::Correlation PlaceSignature::correlate(const PlaceSignature& other) const {
  // Of each harmonic, own times conjugate other; turning the other multiplies it by exp(i k turn).
  Eigen::Matrix<float, kHarmonics + 1, 1> even, odd;
  for (std::size_t k = 0; k <= kHarmonics; ++k) {
    even[k] = cosine_.col(k).dot(other.cosine_.col(k)) + sine_.col(k).dot(other.sine_.col(k));
    odd[k] = cosine_.col(k).dot(other.sine_.col(k)) - sine_.col(k).dot(other.cosine_.col(k));
  }
  return cosines() * even - sines() * odd;
}

}  // namespace cellmap
