#include "cellmap/place/signature_index.hpp"

#include <algorithm>
#include <numbers>
#include <tuple>

#include "cellmap/core/parallel.hpp"
#include "cellmap/place/polar_image.hpp"

namespace cellmap {
namespace {

constexpr double kStepM = 2.0;
constexpr int kSteps = 2;
/// A bin is 4 m by 6 deg and needs no more to be described.
constexpr std::size_t kMostPoints = 20'000;
constexpr std::size_t kKeySize = PlaceSignature::kKeySize;

}  // namespace

DescribedQuery::DescribedQuery(const PointCloud& points) : ground_(fit_ground(points)) {
  const PointCloud few = every_nth(points, points.size() / kMostPoints + 1);
  const Columns columns(transformed(few, ground_.T_ground_sensor));
  for (int i = -kSteps; i <= kSteps; ++i) {
    for (int j = -kSteps; j <= kSteps; ++j) {
      const Eigen::Vector2d centre = kStepM * Eigen::Vector2d(i, j);
      const PlaceSignature signature(columns, centre);
      copies_.push_back({centre, signature, signature.key()});
    }
  }
}

void SignatureIndex::add(CellId id, const PointCloud& points) {
  const GroundFrame ground = fit_ground(points);
  const PlaceSignature signature{Columns(transformed(points, ground.T_ground_sensor))};
  const PlaceSignature::Key key = signature.key();
  const auto [known, is_new] = slots_.emplace(id, ids_.size());
  if (is_new) {
    ids_.push_back(id);
    signatures_.push_back(signature);
    grounds_.push_back(ground);
    keys_.insert(keys_.end(), key.begin(), key.end());
    return;
  }
  const std::size_t slot = known->second;
  signatures_[slot] = signature;
  grounds_[slot] = ground;
  std::copy(key.begin(), key.end(), keys_.begin() + static_cast<std::ptrdiff_t>(slot * kKeySize));
}

void SignatureIndex::remove(CellId id) {
  const auto known = slots_.find(id);
  if (known == slots_.end()) return;
  // The last one takes the place.
  const std::size_t slot = known->second, last = ids_.size() - 1;
  slots_[ids_[last]] = slot;
  slots_.erase(id);
  ids_[slot] = ids_[last];
  signatures_[slot] = signatures_[last];
  grounds_[slot] = grounds_[last];
  std::copy_n(keys_.begin() + static_cast<std::ptrdiff_t>(last * kKeySize), kKeySize,
              keys_.begin() + static_cast<std::ptrdiff_t>(slot * kKeySize));
  ids_.pop_back();
  signatures_.pop_back();
  grounds_.pop_back();
  keys_.resize(last * kKeySize);
}

std::vector<CellId> SignatureIndex::most_alike(const DescribedQuery& query,
                                               const std::vector<std::size_t>& slots,
                                               std::size_t count, int threads) const {
  std::vector<float> likeness(slots.size());
  parallel_for(slots.size(), 256, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Map<const PlaceSignature::Key> key(&keys_[slots[i] * kKeySize]);
      float best = -1;
      // The query's keys stay in the nearest cache.
      for (const DescribedQuery::Copy& copy : query.copies()) {
        best = std::max(best, key.dot(copy.key));
      }
      likeness[i] = best;
    }
  });
  std::vector<std::pair<float, CellId>> ranked;
  for (std::size_t i = 0; i < slots.size(); ++i) ranked.push_back({-likeness[i], ids_[slots[i]]});
  count = std::min(count, ranked.size());
  std::partial_sort(ranked.begin(), ranked.begin() + static_cast<std::ptrdiff_t>(count),
                    ranked.end());
  std::vector<CellId> best;
  for (std::size_t i = 0; i < count; ++i) best.push_back(ranked[i].second);
  return best;
}

std::vector<PlaceAlignment> SignatureIndex::align(const DescribedQuery& query, CellId cell,
                                                  std::size_t count) const {
  constexpr std::size_t kSectors = PlaceSignature::kSectors;
  struct Peak {
    float similarity;
    std::size_t copy, turn;
  };
  const std::size_t slot = slots_.at(cell);
  std::vector<Peak> peaks;
  for (std::size_t c = 0; c < query.copies().size(); ++c) {
    const auto agreement = signatures_[slot].correlate(query.copies()[c].signature);
    for (std::size_t k = 0; k < kSectors; ++k) {
      const float before = agreement[(k + kSectors - 1) % kSectors];
      const float after = agreement[(k + 1) % kSectors];
      if (agreement[k] >= before && agreement[k] > after) peaks.push_back({agreement[k], c, k});
    }
  }
  count = std::min(count, peaks.size());
  std::partial_sort(peaks.begin(), peaks.begin() + static_cast<std::ptrdiff_t>(count), peaks.end(),
                    [](const Peak& a, const Peak& b) {
                      return std::tuple(-a.similarity, a.copy, a.turn) <
                             std::tuple(-b.similarity, b.copy, b.turn);
                    });
  std::vector<PlaceAlignment> best;
  for (std::size_t i = 0; i < count; ++i) {
    // The copy's centre comes to lie on the CELL's origin: p_cell = R (p_query - centre), both in
    // their ground frames.
    const Eigen::Vector2d& centre = query.copies()[peaks[i].copy].centre;
    const double yaw = 2 * std::numbers::pi * static_cast<double>(peaks[i].turn) / kSectors;
    const Pose T_ground_ground =
        upright_pose(0, 0, yaw) * upright_pose(-centre.x(), -centre.y(), 0);
    best.push_back({grounds_[slot].T_ground_sensor.inverse() * T_ground_ground *
                        query.ground().T_ground_sensor,
                    peaks[i].similarity});
  }
  return best;
}

}  // namespace cellmap
