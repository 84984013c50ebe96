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
constexpr float kLowestSeenM = 0.3f, kHighestSeenM = 8.0f;
constexpr float kFiner = 0.7f;

using Mask = Eigen::Matrix<float, kRings, kSectors>;
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

/// Azimuth in turns, from 0 at -180 deg to 1. Within a thousandth of a sector: a polynomial of the
/// arctangent (Abramowitz and Stegun, 4.4.49).
float turn_of(float x, float y) {
  const float ax = std::abs(x), ay = std::abs(y);
  const float most = std::max(ax, ay);
  if (!(most > 0)) return 0.5f;
  const float t = std::min(ax, ay) / most, t2 = t * t;
  float angle = t * (0.9998660f +
                     t2 * (-0.3302995f + t2 * (0.1801410f + t2 * (-0.0851330f + t2 * 0.0208351f))));
  constexpr float kPi = std::numbers::pi_v<float>;
  if (ay > ax) angle = kPi / 2 - angle;
  if (x < 0) angle = kPi - angle;
  return 0.5f + (y < 0 ? -angle : angle) * (0.5f / kPi);
}

/// Mean 0 over what was seen and squared norm 1/2, so that neither heights nor counts outweigh the
/// other; 0 where nothing was seen.
template <typename Block>
void normalise(Block&& values, const Mask& seen) {
  const float count = seen.sum();
  if (!(count > 0)) return;
  const float mean = values.sum() / count;
  values.array() = (values.array() - mean) * seen.array();
  const float norm = values.norm();
  if (norm > 0) values *= std::sqrt(0.5f) / norm;
}

std::size_t sector_of(float x, float y) {
  return std::min(static_cast<std::size_t>(turn_of(x, y) * kSectors), kSectors - 1);
}

/// Rings are finer where more is to be seen: 1.1 m wide nearby, 5.6 m at the rim.
float ring_border_m(std::size_t ring) {
  return static_cast<float>(kMaxRangeM) *
         std::pow(static_cast<float>(ring) / static_cast<float>(kRings), 1 / kFiner);
}

/// The ring of a range, read off a table of steps of 0.1 m.
class RingTable {
 public:
  RingTable() {
    std::size_t i = 0;
    for (std::size_t ring = 0; ring < kRings; ++ring) {
      const float border = ring + 1 < kRings ? ring_border_m(ring + 1) : 2 * kMaxRangeM;
      for (; i < ring_.size() && static_cast<float>(i) * kStepM < border; ++i) {
        ring_[i] = static_cast<std::uint8_t>(ring);
      }
    }
  }
  std::size_t of(float range_m) const {
    return ring_[std::min(static_cast<std::size_t>(range_m / kStepM), ring_.size() - 1)];
  }

 private:
  static constexpr float kStepM = 0.1f;
  std::array<std::uint8_t, 801> ring_;
};

/// Which bins around `centre` lie in sectors that were seen from the origin.
Mask seen_around(const Columns& columns, const Eigen::Vector2d& centre) {
  Mask mask = Mask::Ones();
  if (columns.sees_all()) return mask;
  for (std::size_t ring = 0; ring < kRings; ++ring) {
    const float range = 0.5f * (ring_border_m(ring) + ring_border_m(ring + 1));
    for (std::size_t sector = 0; sector < kSectors; ++sector) {
      const float azimuth =
          ((static_cast<float>(sector) + 0.5f) / kSectors - 0.5f) * 2 * std::numbers::pi_v<float>;
      const float x = static_cast<float>(centre.x()) + range * std::cos(azimuth);
      const float y = static_cast<float>(centre.y()) + range * std::sin(azimuth);
      mask(ring, sector) = columns.seen()[sector_of(x, y)] ? 1.0f : 0.0f;
    }
  }
  return mask;
}

Image image_of(const Columns& columns, const Eigen::Vector2d& centre) {
  Image image = Image::Zero();
  const RingTable rings;
  for (const Columns::Column& column : columns.all()) {
    const float x = column.x - static_cast<float>(centre.x());
    const float y = column.y - static_cast<float>(centre.y());
    const float range = std::sqrt(x * x + y * y);
    if (!(range < static_cast<float>(kMaxRangeM))) continue;
    const std::size_t ring = rings.of(range), sector = sector_of(x, y);
    image(ring, sector) = std::max(
        image(ring, sector), std::clamp(column.top_m, kLowestSeenM, kHighestSeenM) - kLowestSeenM);
    image(kRings + ring, sector) += column.upright;
  }
  image.bottomRows<kRings>() = image.bottomRows<kRings>().array().log1p();
  const Mask seen = seen_around(columns, centre);
  normalise(image.topRows<kRings>(), seen);
  normalise(image.bottomRows<kRings>(), seen);
  return image;
}

}  // namespace

Columns::Columns(const PointCloud& points) {
  constexpr auto kReach = static_cast<float>(kReachM);
  constexpr auto kSide = static_cast<std::size_t>(2 * kReachM);
  std::vector<std::uint32_t> column_of(kSide * kSide, 0);  // position plus 1
  for (std::size_t i = 0; i < points.size(); ++i) {
    const float x = points.x[i], y = points.y[i];
    if (std::isfinite(x) && std::isfinite(y) && (x != 0 || y != 0)) seen_[sector_of(x, y)] = true;
    if (!(std::abs(x) < kReach && std::abs(y) < kReach && points.z[i] > kLowestSeenM)) continue;
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

bool Columns::sees_all() const {
  return std::all_of(seen_.begin(), seen_.end(), [](bool seen) { return seen; });
}

PlaceSignature::PlaceSignature(const Columns& columns, const Eigen::Vector2d& centre) {
  const Image image = image_of(columns, centre);
  for (std::size_t s = 0; s < kSectors; ++s) energy_[s] = image.col(s).squaredNorm();
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

PlaceSignature::Correlation PlaceSignature::correlate(const PlaceSignature& other) const {
  // Of each harmonic, own times conjugate other; turning the other multiplies it by exp(i k turn).
  Eigen::Matrix<float, kHarmonics + 1, 1> even, odd;
  for (std::size_t k = 0; k <= kHarmonics; ++k) {
    even[k] = cosine_.col(k).dot(other.cosine_.col(k)) + sine_.col(k).dot(other.sine_.col(k));
    odd[k] = cosine_.col(k).dot(other.sine_.col(k)) - sine_.col(k).dot(other.cosine_.col(k));
  }
  return cosines() * even - sines() * odd;
}

PlaceSignature::Correlation PlaceSignature::visible_share(
    const std::array<bool, kSectors>& seen) const {
  constexpr float kLeast = 0.6f;
  Correlation share;
  for (std::size_t k = 0; k < kSectors; ++k) {
    float sum = 0;
    for (std::size_t s = 0; s < kSectors; ++s) sum += seen[s] ? energy_[(s + k) % kSectors] : 0.0f;
    share[k] = std::clamp(std::sqrt(sum), kLeast, 1.0f);
  }
  return share;
}

simd::TurnedViews PlaceSignature::side_by_side(const std::vector<PlaceSignature>& signatures) {
  simd::TurnedViews views;
  views.views = signatures.size();
  views.rows = kRows;
  views.harmonics = kHarmonics + 1;
  views.cosine.assign(kRows * (kHarmonics + 1) * simd::TurnedViews::kViews, 0.0f);
  views.sine = views.cosine;
  views.cosine_of_turn = kTables.cosine.data();
  views.sine_of_turn = kTables.sine.data();
  for (std::size_t v = 0; v < signatures.size(); ++v) {
    for (std::size_t i = 0; i < kRows * (kHarmonics + 1); ++i) {
      views.cosine[i * simd::TurnedViews::kViews + v] = signatures[v].cosine_.data()[i];
      views.sine[i * simd::TurnedViews::kViews + v] = signatures[v].sine_.data()[i];
    }
  }
  return views;
}

void PlaceSignature::correlate(const simd::TurnedViews& views, std::size_t harmonics,
                               std::array<float, kSectors>& best) const {
  simd::correlate_turned(views, cosine_.data(), sine_.data(), harmonics, best);
}

float PlaceSignature::most_alike(const simd::TurnedViews& views, std::size_t harmonics) const {
  return simd::best_turned(views, cosine_.data(), sine_.data(), harmonics);
}

}  // namespace cellmap
