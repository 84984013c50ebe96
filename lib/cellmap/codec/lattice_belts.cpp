#include "cellmap/codec/lattice_belts.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

namespace cellmap {
namespace {

constexpr std::uint64_t kGoldenTurn = 0x9E3779B97F4A7C15;  // 2^64 / phi
constexpr double kRadPerUnit = 2 * std::numbers::pi * 0x1p-64;
constexpr double kBandFloors[] = {-0.20, -0.60};  // FORMAT.md, "Lattices"

/// Sums of up to `reach` times each of two successive Fibonacci numbers, which are a reduced basis:
/// all short vectors of the lattice of every `divisor`-th point. Increasing, each once, those from
/// 1 to `limit`.
std::vector<std::uint32_t> short_steps(int reach, std::uint32_t divisor, std::uint32_t limit) {
  std::vector<std::uint32_t> steps;
  for (std::int64_t f = 1, next = 2; f <= limit;) {
    for (int a = 0; a <= reach; ++a) {
      for (int b = -reach; b <= reach; ++b) {
        const std::int64_t step = a * f + b * next;
        if (step < 1 || step > limit || step % divisor != 0) continue;
        steps.push_back(static_cast<std::uint32_t>(step));
      }
    }
    const std::int64_t after = f + next;
    f = next;
    next = after;
  }
  std::sort(steps.begin(), steps.end());
  steps.erase(std::unique(steps.begin(), steps.end()), steps.end());
  return steps;
}

/// Which point of its sphere a direction of a lattice of bands is: the spheres' axis is y, along
/// which points follow in equal steps.
std::uint32_t point_along_axis(double y, std::uint32_t divisor) {
  return static_cast<std::uint32_t>(std::floor((1 - y) * divisor / 2 + 0.5));
}

std::vector<LatticeSphere> band_spheres(const Lattice& lattice) {
  const std::uint32_t n = lattice.spec().size;
  std::vector<LatticeSphere> spheres;
  for (const std::uint32_t size : {n, 2 * n, n / 200}) {
    LatticeSphere sphere;
    sphere.size = size;
    sphere.divisor = size - 1;
    spheres.push_back(std::move(sphere));
  }
  std::vector<std::uint32_t> indices(lattice.size());
  std::iota(indices.begin(), indices.end(), 0u);
  std::vector<double> x(indices.size()), y(indices.size()), z(indices.size());
  lattice.directions(indices, x.data(), y.data(), z.data());
  for (std::size_t k = 0; k < z.size(); ++k) {
    LatticeSphere& sphere = spheres[z[k] >= kBandFloors[0] ? 0 : z[k] >= kBandFloors[1] ? 1 : 2];
    sphere.points.push_back(point_along_axis(y[k], sphere.divisor));
  }
  std::uint32_t first = 0;
  for (LatticeSphere& sphere : spheres) {
    sphere.first = first;
    sphere.count = static_cast<std::uint32_t>(sphere.points.size());
    first += sphere.count;
  }
  return spheres;
}

}  // namespace

double LatticeSphere::patch_radius_rad() const { return 2.0 / std::sqrt(double(size)); }

std::vector<LatticeSphere> spheres_of(const Lattice& lattice) {
  if (lattice.spec().kind == LatticeKind::kFibonacciBands) return band_spheres(lattice);
  LatticeSphere sphere;
  sphere.size = sphere.divisor = sphere.count = lattice.size();
  sphere.offset = 1;
  return {sphere};
}

LatticeBelts::LatticeBelts(const LatticeSphere& sphere)
    : size_(sphere.size),
      divisor_(sphere.divisor),
      offset_(sphere.offset),
      margin_(static_cast<std::uint32_t>(16 * std::sqrt(double(size_))) + 32),
      belts_(size_ / kBeltPoints + 1) {
  const auto measured = [this](const std::vector<std::uint32_t>& steps) {
    std::vector<Candidate> candidates;
    for (const std::uint32_t step : steps) {
      const auto turn = static_cast<std::int64_t>(step * kGoldenTurn);
      const double azimuth = static_cast<double>(turn) * kRadPerUnit;
      const double height = 2.0 * step / divisor_;
      candidates.push_back({step, azimuth * azimuth, height * height});
    }
    return candidates;
  };
  fine_ = measured(short_steps(2, 1, margin_ / 2));
  coarse_ = measured(short_steps(4, kCoarsePoints, margin_));
}

LatticeBelts::Steps LatticeBelts::nearest_steps(const std::vector<Candidate>& candidates, double r2,
                                                Places& nearest) {
  double limit = 0;  // none of the eight nearest is farther
  for (const std::uint32_t place : nearest) {
    limit = std::max(limit, candidates[place].distance2(r2));
  }
  std::array<double, kNeighbours + 1> distances2;  // ascending, and room for one more
  std::array<std::uint32_t, kNeighbours + 1> places;
  std::size_t count = 0;
  for (std::uint32_t place = 0; place < candidates.size(); ++place) {
    const Candidate& c = candidates[place];
    if (c.azimuth2_rad2 * r2 > limit) continue;
    if (c.height2 / r2 > limit) break;  // as are all after it
    const double distance2 = c.distance2(r2);
    if (distance2 > limit) continue;
    std::size_t at = count;
    for (; at > 0 && distance2 < distances2[at - 1]; --at) {
      distances2[at] = distances2[at - 1];
      places[at] = places[at - 1];
    }
    distances2[at] = distance2;
    places[at] = place;
    count = std::min(count + 1, kNeighbours);
    if (count == kNeighbours) limit = distances2[kNeighbours - 1];
  }
  Steps steps;
  for (std::size_t n = 0; n < kNeighbours; ++n) {
    nearest[n] = places[n];
    steps[n] = candidates[places[n]].step;
  }
  return steps;
}

void LatticeBelts::enter(Belt& belt, std::uint32_t number) {
  const std::uint64_t middle =
      std::min<std::uint64_t>(std::uint64_t{number} * kBeltPoints + kBeltPoints / 2, size_ - 1);
  const double m = divisor_;
  const double a = std::max<double>(1, 2.0 * static_cast<double>(middle) + offset_);
  const double r2 = std::max(a * (2 * m - a), 1.0) / (m * m);  // squared radius of its circle
  const Steps coarse = nearest_steps(coarse_, r2, nearest_coarse_);
  const Steps fine = nearest_steps(fine_, r2, nearest_fine_);
  for (std::uint32_t rest = 0; rest < kCoarsePoints; ++rest) {
    Offsets& offsets = belt.of[rest].offsets;
    std::size_t count = 0;
    const Steps& steps = rest == 0 ? coarse : fine;
    belt.of[rest].least_step = *std::min_element(steps.begin(), steps.end());
    for (const std::uint32_t step : steps) {
      const auto offset = static_cast<std::int32_t>(step);
      if (count < kNeighbours) offsets[count++] = -offset;
      const bool is_coarse_after = rest != 0 && (rest + step) % kCoarsePoints == 0;
      if (is_coarse_after && count < kNeighbours) offsets[count++] = offset;
    }
  }
  belt.is_known = true;
}

CodingLattice::CodingLattice(const LatticeSpec& spec)
    : lattice(spec), spheres(spheres_of(lattice)) {
  for (const LatticeSphere& sphere : spheres) {
    belts.emplace_back(sphere);
    first_place.push_back(places + belts.back().margin());
    places += sphere.size + 2 * belts.back().margin();
  }
}

}  // namespace cellmap
