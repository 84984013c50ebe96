#include "cellmap/place/signature_index.hpp"

#include <algorithm>
#include <numbers>
#include <tuple>

#include "cellmap/core/parallel.hpp"
#include "cellmap/place/polar_image.hpp"

namespace cellmap {
namespace {

constexpr double kCentreStepM = 2.0;
constexpr int kSteps = 2;
/// A bin is 4 m by 6 deg and needs no more to be described.
constexpr std::size_t kMostViewPoints = 20'000;
constexpr std::size_t kTurns = PlaceSignature::kSectors;
/// Of the first look at many CELLs. With seven, one in eight occluded queries lost its place.
constexpr std::size_t kFirstLookHarmonics = 10;
constexpr std::size_t kAllHarmonics = PlaceSignature::kHarmonics + 1;

}  // namespace

DescribedQuery::DescribedQuery(const PointCloud& points) : ground_(fit_ground(points)) {
  const PointCloud few = every_nth(points, points.size() / kMostViewPoints + 1);
  const Columns columns(transformed(few, ground_.T_ground_sensor));
  seen_ = columns.seen();
  sees_all_ = columns.sees_all();
  std::vector<PlaceSignature> signatures, some;
  for (int i = -kSteps; i <= kSteps; ++i) {
    for (int j = -kSteps; j <= kSteps; ++j) {
      const Eigen::Vector2d centre = kCentreStepM * Eigen::Vector2d(i, j);
      signatures.emplace_back(columns, centre);
      copies_.push_back({centre, signatures.back()});
      if ((i + j) % 2 == 0) some.push_back(signatures.back());
    }
  }
  views_ = PlaceSignature::side_by_side(signatures);
  some_views_ = PlaceSignature::side_by_side(some);
}

void SignatureIndex::add(CellId id, const PointCloud& points) {
  const GroundFrame ground = fit_ground(points);
  const PlaceSignature signature{Columns(transformed(points, ground.T_ground_sensor))};
  const auto [known, is_new] = slots_.emplace(id, ids_.size());
  if (is_new) {
    ids_.push_back(id);
    signatures_.push_back(signature);
    grounds_.push_back(ground);
    return;
  }
  const std::size_t slot = known->second;
  signatures_[slot] = signature;
  grounds_[slot] = ground;
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
  ids_.pop_back();
  signatures_.pop_back();
  grounds_.pop_back();
}

float SignatureIndex::likeness(const DescribedQuery& query, std::size_t slot) const {
  if (query.sees_all()) return signatures_[slot].most_alike(query.views(), kAllHarmonics);
  std::array<float, kTurns> by_turn;
  signatures_[slot].correlate(query.views(), kAllHarmonics, by_turn);
  const PlaceSignature::Correlation visible = signatures_[slot].visible_share(query.seen());
  for (std::size_t k = 0; k < kTurns; ++k) by_turn[k] /= visible[k];
  return *std::max_element(by_turn.begin(), by_turn.end());
}

template <typename Likeness>
std::vector<std::size_t> SignatureIndex::best_of(const std::vector<std::size_t>& slots,
                                                 std::size_t count, int threads,
                                                 const Likeness& likeness) const {
  std::vector<std::tuple<float, CellId, std::size_t>> ranked(slots.size());
  parallel_for(slots.size(), 64, threads, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      ranked[i] = {-likeness(slots[i]), ids_[slots[i]], slots[i]};
    }
  });
  count = std::min(count, ranked.size());
  std::partial_sort(ranked.begin(), ranked.begin() + static_cast<std::ptrdiff_t>(count),
                    ranked.end());
  std::vector<std::size_t> best;
  for (std::size_t i = 0; i < count; ++i) best.push_back(std::get<2>(ranked[i]));
  return best;
}

std::vector<CellId> SignatureIndex::most_alike(const DescribedQuery& query,
                                               const std::vector<std::size_t>& slots,
                                               std::size_t count, int threads) const {
  std::vector<std::size_t> some;
  if (slots.size() > kCompareAll) {
    some = best_of(slots, std::max(count, kShortlist), threads, [&](std::size_t slot) {
      return signatures_[slot].most_alike(query.some_views(), kFirstLookHarmonics);
    });
  }
  std::vector<CellId> best;
  for (const std::size_t slot : best_of(some.empty() ? slots : some, count, threads,
                                        [&](std::size_t slot) { return likeness(query, slot); })) {
    best.push_back(ids_[slot]);
  }
  return best;
}

std::vector<PlaceAlignment> SignatureIndex::align(const DescribedQuery& query, CellId cell,
                                                  std::size_t count) const {
  struct Peak {
    float similarity;
    std::size_t copy, turn;
  };
  const std::size_t slot = slots_.at(cell);
  std::vector<Peak> peaks;
  const PlaceSignature::Correlation visible = query.sees_all()
                                                  ? PlaceSignature::Correlation::Ones().eval()
                                                  : signatures_[slot].visible_share(query.seen());
  for (std::size_t c = 0; c < query.copies().size(); ++c) {
    const PlaceSignature::Correlation agreement =
        signatures_[slot].correlate(query.copies()[c].signature).cwiseQuotient(visible);
    for (std::size_t k = 0; k < kTurns; ++k) {
      const float before = agreement[(k + kTurns - 1) % kTurns];
      const float after = agreement[(k + 1) % kTurns];
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
    const double yaw = 2 * std::numbers::pi * static_cast<double>(peaks[i].turn) / kTurns;
    const Pose T_ground_ground =
        upright_pose(0, 0, yaw) * upright_pose(-centre.x(), -centre.y(), 0);
    best.push_back({grounds_[slot].T_ground_sensor.inverse() * T_ground_ground *
                        query.ground().T_ground_sensor,
                    peaks[i].similarity});
  }
  return best;
}

}  // namespace cellmap
