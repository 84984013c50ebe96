#include "cellmap/geometry/lattice.hpp"

#include <cassert>
#include <cmath>
#include <map>
#include <mutex>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

using Points = std::variant<FibonacciSphere, FibonacciBands>;

Points points_of(const LatticeSpec& spec) {
  spec.validate();
  if (spec.kind == LatticeKind::kFibonacciBands) return FibonacciBands(spec.size);
  return FibonacciSphere(spec.size, FibonacciSphere::Ends::kBesidePoles);
}

double radius_rad(double points_on_sphere) { return 2.0 / std::sqrt(points_on_sphere); }

}  // namespace

std::string to_string(LatticeKind kind) {
  switch (kind) {
    case LatticeKind::kFibonacci:
      return "fibonacci";
    case LatticeKind::kFibonacciBands:
      return "fibonacci-bands";
  }
  return "kind" + std::to_string(static_cast<int>(kind));
}

LatticeKind lattice_kind_from(std::string_view name) {
  for (const LatticeKind kind : {LatticeKind::kFibonacci, LatticeKind::kFibonacciBands}) {
    if (name == to_string(kind)) return kind;
  }
  throw Error(ErrorCode::kUnsupported, "lattice kind '" + std::string(name) +
                                           "' is unknown; this build knows 'fibonacci' and "
                                           "'fibonacci-bands'");
}

void LatticeSpec::validate() const {
  const bool has_bands = kind == LatticeKind::kFibonacciBands;
  if (kind != LatticeKind::kFibonacci && !has_bands) {
    throw Error(ErrorCode::kUnsupported, "lattice kind " + std::to_string(static_cast<int>(kind)) +
                                             " is unknown; this build knows 1 (fibonacci) and 2 "
                                             "(fibonacci-bands)");
  }
  if (size < 1'000 || size > (has_bands ? 500'000U : 1'000'000U)) {
    throw Error(ErrorCode::kUnsupported,
                "a lattice " + to_string(kind) + " of size " + std::to_string(size) +
                    " is not supported; give 1,000 to " + (has_bands ? "500,000" : "1,000,000"));
  }
}

std::string to_string(const LatticeSpec& spec) {
  return to_string(spec.kind) + "-" + std::to_string(spec.size);
}

Lattice::Lattice(const LatticeSpec& spec) : spec_(spec), points_(points_of(spec)) {}

std::uint32_t Lattice::size() const {
  return std::visit([](const auto& points) { return points.size(); }, points_);
}

Eigen::Vector3d Lattice::direction(std::uint32_t index) const {
  assert(index < size());
  return std::visit([&](const auto& points) { return points.direction(index); }, points_);
}

void Lattice::directions(std::span<const std::uint32_t> indices, double* x, double* y,
                         double* z) const {
  std::visit([&](const auto& points) { points.directions(indices, x, y, z); }, points_);
}

std::uint32_t Lattice::nearest(const Eigen::Vector3d& direction) const {
  return std::visit([&](const auto& points) { return points.nearest(direction); }, points_);
}

void Lattice::nearest(const PointCloud& cloud, std::span<std::uint32_t> indices) const {
  assert(indices.size() == cloud.size());
  nearest(cloud.x.data(), cloud.y.data(), cloud.z.data(), indices);
}

void Lattice::nearest(const float* x, const float* y, const float* z,
                      std::span<std::uint32_t> indices) const {
  std::visit([&](const auto& points) { points.nearest(x, y, z, indices); }, points_);
}

double Lattice::patch_radius_rad(std::uint32_t index) const {
  if (const auto* bands = std::get_if<FibonacciBands>(&points_)) {
    return bands->patch_radius_rad(index);
  }
  return patch_radius_rad();
}

double Lattice::patch_radius_rad() const {
  return radius_rad(spec_.kind == LatticeKind::kFibonacciBands ? 2.0 * spec_.size : spec_.size);
}

struct LatticeCache::Impl {
  std::mutex mutex;
  std::map<std::pair<LatticeKind, std::uint32_t>, std::shared_ptr<const Lattice>> lattices;
};

LatticeCache::LatticeCache() : impl_(std::make_unique<Impl>()) {}
LatticeCache::~LatticeCache() = default;

std::shared_ptr<const Lattice> LatticeCache::get(const LatticeSpec& spec) {
  spec.validate();
  const std::scoped_lock lock(impl_->mutex);
  std::shared_ptr<const Lattice>& lattice = impl_->lattices[{spec.kind, spec.size}];
  if (!lattice) lattice = std::make_shared<const Lattice>(spec);
  return lattice;
}

}  // namespace cellmap
