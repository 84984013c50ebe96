#include "cellmap/codec/lattice_belts.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>

namespace cellmap {
namespace {

constexpr std::uint64_t kGoldenTurn = 0x9E3779B97F4A7C15;  // 2^64 / phi
constexpr double kRadPerUnit = 2 * std::numbers::pi * 0x1p-64;
constexpr double kBandFloors[] = {-0.20, -0.60};  // FORMAT.md, "Lattices"

/// Fibonacci numbers, their doubles and the sums of one with the next but one: with two successive
/// ones as a reduced basis, all short vectors of the lattice.
std::vector<std::uint32_t> short_steps(std::uint32_t limit) {
  std::vector<std::uint32_t> steps;
  for (std::uint32_t f = 1, next = 2; f <= limit;) {
    for (const std::uint32_t step : {f, 2 * f, f + (f + next)}) {
      if (step <= limit) steps.push_back(step);
    }
    const std::uint32_t after = f + next;
    f = next;
    next = after;
  }
  std::sort(steps.begin(), steps.end());
  steps.erase(std::unique(steps.begin(), steps.end()), steps.end());
  return steps;
}

/// Which point of its sphere a direction of a lattice of bands is: heights fall in equal steps.
std::uint32_t point_at_height(double z, std::uint32_t divisor) {
  return static_cast<std::uint32_t>(std::floor((1 - z) * divisor / 2 + 0.5));
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
  for (const double height : z) {
    LatticeSphere& sphere = spheres[height >= kBandFloors[0]   ? 0
                                    : height >= kBandFloors[1] ? 1
                                                               : 2];
    sphere.points.push_back(point_at_height(height, sphere.divisor));
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
    : size_(sphere.size), divisor_(sphere.divisor), offset_(sphere.offset) {
  const auto limit = static_cast<std::uint32_t>(8 * std::sqrt(double(size_))) + 16;
  for (const std::uint32_t step : short_steps(limit)) {
    const auto turn = static_cast<std::int64_t>(step * kGoldenTurn);
    candidates_.push_back({step, static_cast<double>(turn) * kRadPerUnit});
  }
}

void LatticeBelts::enter(std::uint32_t belt) {
  belt_ = belt;
  const std::uint64_t middle =
      std::min<std::uint64_t>(std::uint64_t{belt} * kBeltPoints + kBeltPoints / 2, size_ - 1);
  const double m = divisor_;
  const double a = std::max<double>(1, 2.0 * static_cast<double>(middle) + offset_);
  const double r2 = std::max(a * (2 * m - a), 1.0) / (m * m);  // squared radius of its circle
  struct Near {
    double distance2;
    std::uint32_t step;
  };
  std::array<Near, 128> near;
  std::size_t count = 0;
  for (const Candidate& c : candidates_) {
    const double height = 2.0 * c.step / m;
    const double across = c.azimuth_rad * c.azimuth_rad * r2;
    const double along = height * height / r2;
    near[count++] = {across + along, c.step};
  }
  const auto nearer = [](const Near& p, const Near& q) {
    return p.distance2 < q.distance2 || (p.distance2 == q.distance2 && p.step < q.step);
  };
  std::partial_sort(near.begin(), near.begin() + kNeighbours, near.begin() + count, nearer);
  for (std::size_t n = 0; n < kNeighbours; ++n) steps_[n] = near[n].step;
}

}  // namespace cellmap
