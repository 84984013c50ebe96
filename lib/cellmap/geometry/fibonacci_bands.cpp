#include "cellmap/geometry/fibonacci_bands.hpp"

#include <algorithm>
#include <bit>
#include <cassert>
#include <cmath>
#include <numbers>
#include <numeric>

namespace cellmap {
namespace {

using Ends = FibonacciSphere::Ends;

constexpr double kTop = 0.70, kMiddle = -0.20, kBottom = -0.60;
constexpr std::uint32_t kCoarser = 200;
constexpr double kPi = std::numbers::pi;

/// Between the frame of the lattice, z up, and that of a sphere, whose axis lies along y.
Eigen::Vector3d swapped(const Eigen::Vector3d& v) { return {v.x(), v.z(), v.y()}; }

double dot(const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  return a.x() * b.x() + a.y() * b.y() + a.z() * b.z();
}

/// Whether a direction is above all bands, as FORMAT.md evaluates it.
bool is_above(const Eigen::Vector3d& d, double norm2) {
  return d.z() > 0 && 100 * (d.z() * d.z()) >= 49 * norm2;
}

}  // namespace

FibonacciBands::Band::Band(std::uint32_t sphere_size, double low, double high, std::uint32_t first)
    : rings(FibonacciSphere::rings(sphere_size, Ends::kOnPoles)),
      low(low),
      high(high),
      patch_radius_rad(2.0 / std::sqrt(static_cast<double>(sphere_size))),
      first(first) {
  constexpr std::uint32_t kBlock = 64;
  std::array<std::uint32_t, kBlock> index;
  std::array<double, kBlock> x, y, z;
  for (std::uint32_t begin = 0; begin < sphere_size; begin += kBlock) {
    const std::uint32_t count = std::min(kBlock, sphere_size - begin);
    std::iota(index.begin(), index.end(), begin);
    simd::directions(rings, index.data(), count, x.data(), y.data(), z.data());
    Members members{0, static_cast<std::uint32_t>(points.size())};
    for (std::uint32_t k = 0; k < count; ++k) {
      const bool is_member = low <= y[k] && y[k] < high;  // y of the sphere is the lattice's z
      members.bits |= std::uint64_t{is_member} << k;
      if (is_member) points.push_back(begin + k);
    }
    members_.push_back(members);
  }
}

std::uint32_t FibonacciBands::Band::index_of(std::uint32_t point) const {
  const Members& members = members_[point / 64];
  const std::uint64_t bit = std::uint64_t{1} << point % 64;
  assert(members.bits & bit);
  return first + members.before +
         static_cast<std::uint32_t>(std::popcount(members.bits & (bit - 1)));
}

void FibonacciBands::Border::add(const Band& band, double depth, double height) {
  const DirectionTable directions(band.rings, band.points);
  for (std::uint32_t k = 0; k < band.points.size(); ++k) {
    const Eigen::Vector3d point = directions[k];
    if (std::abs(point.y() - height) > depth) continue;
    candidates.push_back({std::atan2(point.z(), point.x()), point, band.first + k});
  }
}

void FibonacciBands::Border::sort() {
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.azimuth < b.azimuth; });
}

std::uint32_t FibonacciBands::Border::nearest(const Eigen::Vector3d& point, double chord) const {
  std::uint32_t best = 0;
  double best_dot = -HUGE_VAL;
  const auto offer_between = [&](double from, double to) {
    const auto before = [](const Candidate& c, double azimuth) { return c.azimuth < azimuth; };
    for (auto c = std::lower_bound(candidates.begin(), candidates.end(), from, before);
         c != candidates.end() && c->azimuth <= to; ++c) {
      const double candidate = dot(c->point, point);
      if (candidate > best_dot || (candidate == best_dot && c->index < best)) {
        best_dot = candidate;
        best = c->index;
      }
    }
  };
  // A half-plane through the axis that is turned away by an angle is sin(angle) of the radius away.
  const double radius = std::hypot(point.x(), point.z()) / point.norm();
  if (chord >= 0.99 * radius) {
    offer_between(-HUGE_VAL, HUGE_VAL);
  } else {
    const double azimuth = std::atan2(point.z(), point.x());
    const double window = std::asin(chord / radius) + 1e-9;
    offer_between(azimuth - window, azimuth + window);
    if (azimuth - window < -kPi) offer_between(azimuth - window + 2 * kPi, HUGE_VAL);
    if (azimuth + window > kPi) offer_between(-HUGE_VAL, azimuth + window - 2 * kPi);
  }
  assert(best_dot > -HUGE_VAL);
  return best;
}

FibonacciBands::FibonacciBands(std::uint32_t size)
    : bands_{Band(size, kMiddle, kTop, 0), Band(2 * size, kBottom, kMiddle, 0),
             Band(size / kCoarser, -HUGE_VAL, kBottom, 0)},
      spheres_{FibonacciSphere(size, Ends::kOnPoles), FibonacciSphere(2 * size, Ends::kOnPoles)} {
  bands_[1].first = bands_[0].end();
  bands_[2].first = bands_[1].end();
  const double depth_0 = 2 * spheres_[0].spacing(), depth_1 = 2 * spheres_[1].spacing();
  top_.add(bands_[0], depth_0, kTop);
  middle_.add(bands_[0], depth_0, kMiddle);
  middle_.add(bands_[1], depth_1, kMiddle);
  bottom_.add(bands_[1], depth_1, kBottom);
  bottom_.add(bands_[2], HUGE_VAL, kBottom);
  for (Border* border : {&top_, &middle_, &bottom_}) border->sort();
  lowest_ = DirectionTable(bands_[2].rings, bands_[2].points);
}

const FibonacciBands::Band& FibonacciBands::band_of(std::uint32_t index) const {
  assert(index < size());
  return bands_[index < bands_[1].first ? 0 : index < bands_[2].first ? 1 : 2];
}

Eigen::Vector3d FibonacciBands::direction(std::uint32_t index) const {
  const Band& band = band_of(index);
  return swapped(FibonacciSphere::direction(band.rings, band.points[index - band.first]));
}

void FibonacciBands::directions(std::span<const std::uint32_t> indices, double* x, double* y,
                                double* z) const {
  constexpr std::size_t kBlock = 256;
  std::array<std::uint32_t, kBlock> point;
  for (std::size_t begin = 0, end; begin < indices.size(); begin = end) {
    const Band& band = band_of(indices[begin]);
    for (end = begin; end < std::min(indices.size(), begin + kBlock); ++end) {
      if (indices[end] < band.first || indices[end] >= band.end()) break;
      point[end - begin] = band.points[indices[end] - band.first];
    }
    simd::directions(band.rings, point.data(), end - begin, x + begin, z + begin, y + begin);
  }
}

std::uint32_t FibonacciBands::nearest(const Eigen::Vector3d& direction) const {
  const double norm2 =
      direction.x() * direction.x() + direction.y() * direction.y() + direction.z() * direction.z();
  assert(norm2 > 0 && std::isfinite(norm2));
  if (is_above(direction, norm2)) return simd::kUndecided;
  const Eigen::Vector3d point = swapped(direction);
  const double norm = std::sqrt(norm2);
  const double height = direction.z() / norm;
  if (height < kBottom) return nearest_in_bottom(point, norm, height);
  const std::size_t k = height < kMiddle ? 1 : 0;
  const double spacing = spheres_[k].spacing();
  if (height - bands_[k].low < spacing) {
    return (k == 0 ? middle_ : bottom_).nearest(point, 2 * spacing);
  }
  if (bands_[k].high - height < spacing) {
    return (k == 0 ? top_ : middle_).nearest(point, 2 * spacing);
  }
  return bands_[k].index_of(spheres_[k].nearest(point));
}

/// Below all borders.
std::uint32_t FibonacciBands::nearest_in_bottom(const Eigen::Vector3d& point, double norm,
                                                double height) const {
  const std::size_t count = bands_[2].points.size();
  if (count == 0) return bottom_.nearest(point, 2);
  const std::size_t best = simd::largest_dot(lowest_.view(), 0, count, point.data(), false);
  const double chord = std::sqrt(std::max(0.0, 2 - 2 * dot(lowest_[best], point) / norm) + 1e-14);
  if (chord < kBottom - height) return bands_[2].first + static_cast<std::uint32_t>(best);
  return bottom_.nearest(point, chord);
}

void FibonacciBands::nearest(const float* x, const float* y, const float* z,
                             std::span<std::uint32_t> indices) const {
  constexpr std::size_t kBlock = 512;
  struct Gathered {
    std::array<float, kBlock> x, y, z;
    std::array<std::uint32_t, kBlock> at, point;
    std::size_t count;
    float low, high;
  };
  std::array<Gathered, 2> gathered;
  for (std::size_t k = 0; k < 2; ++k) {
    const double margin = spheres_[k].spacing() + 1e-5;  // floats are good to 1e-6
    gathered[k].low = static_cast<float>(bands_[k].low + margin);
    gathered[k].high = static_cast<float>(bands_[k].high - margin);
  }
  for (std::size_t begin = 0; begin < indices.size(); begin += kBlock) {
    const std::size_t end = std::min(begin + kBlock, indices.size());
    gathered[0].count = gathered[1].count = 0;
    for (std::size_t i = begin; i < end; ++i) {
      const float norm2 = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
      const float height = z[i] / std::sqrt(norm2);
      bool is_inside = norm2 > 1e-30f && norm2 < 1e38f;
      Gathered& g = gathered[height < static_cast<float>(kMiddle) ? 1 : 0];
      is_inside = is_inside && height > g.low && height < g.high;
      if (is_inside) {
        g.x[g.count] = x[i];
        g.y[g.count] = y[i];
        g.z[g.count] = z[i];
        g.at[g.count++] = static_cast<std::uint32_t>(i - begin);
        continue;
      }
      const Eigen::Vector3d direction(x[i], y[i], z[i]);
      const double double_norm2 = direction.squaredNorm();
      indices[i] =
          double_norm2 > 0 && std::isfinite(double_norm2) ? nearest(direction) : simd::kUndecided;
    }
    for (std::size_t k = 0; k < 2; ++k) {
      Gathered& g = gathered[k];
      spheres_[k].nearest(g.x.data(), g.z.data(), g.y.data(), std::span(g.point).first(g.count));
      for (std::size_t j = 0; j < g.count; ++j) {
        indices[begin + g.at[j]] = bands_[k].index_of(g.point[j]);
      }
    }
  }
}

}  // namespace cellmap
