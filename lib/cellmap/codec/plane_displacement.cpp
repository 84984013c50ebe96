#include "cellmap/codec/plane_displacement.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// n / (n . p) of a plane of which p = distance * direction is a point.
Eigen::Vector3d inverse_range(const Plane& plane, const Eigen::Vector3d& direction) {
  const Eigen::Vector3d n(plane.nx, plane.ny, plane.nz);
  return n / (n.dot(direction) * double{plane.distance_m});
}

/// a + b cos(phi) + c sin(phi): m . v on the rim of the disc.
struct Rim {
  double a, b, c;
  Rim(const Eigen::Vector3d& m, const Eigen::Vector3d& u, double radius_rad) {
    const Eigen::Vector3d t1 = u.unitOrthogonal();
    const Eigen::Vector3d t2 = u.cross(t1);
    a = m.dot(u) * std::cos(radius_rad);
    b = m.dot(t1) * std::sin(radius_rad);
    c = m.dot(t2) * std::sin(radius_rad);
  }
};

}  // namespace

double plane_displacement_m(const Plane& source, const Plane& decoded, const Eigen::Vector3d& u,
                            double radius_rad) {
  if (source == decoded) return 0;
  const Eigen::Vector3d m = inverse_range(source, u);
  const Eigen::Vector3d m_decoded = inverse_range(decoded, u);
  const Rim after(m_decoded, u, radius_rad);
  const Rim change(m - m_decoded, u, radius_rad);
  if (!(after.a > std::hypot(after.b, after.c))) return std::numeric_limits<double>::infinity();
  // change = x after somewhere on the rim, for the least and the largest x:
  // (change.a - x after.a)^2 = (change.b - x after.b)^2 + (change.c - x after.c)^2.
  const double p = after.a * after.a - after.b * after.b - after.c * after.c;
  const double q = change.a * after.a - change.b * after.b - change.c * after.c;
  const double r = change.a * change.a - change.b * change.b - change.c * change.c;
  const double root = std::sqrt(std::max(0.0, q * q - p * r));
  const double displacement = (std::abs(q) + root) / (p * m.norm());
  return std::isnan(displacement) ? std::numeric_limits<double>::infinity() : displacement;
}

CellDisplacement cell_displacement(const Cell& source, const Cell& decoded) {
  if (source.lattice != decoded.lattice || source.indices != decoded.indices ||
      source.planes.size() != decoded.planes.size()) {
    throw Error(ErrorCode::kInvalidArgument,
                "a decoded CELL is compared with its source, which has the same lattice points");
  }
  CellDisplacement result;
  const Lattice lattice(source.lattice);
  std::vector<double> all;
  all.reserve(source.planes.size());
  for (std::size_t k = 0; k < source.planes.size(); ++k) {
    const std::uint32_t index = source.indices[k];
    all.push_back(plane_displacement_m(source.planes[k], decoded.planes[k],
                                       lattice.direction(index), lattice.patch_radius_rad(index)));
    if (all.back() > result.worst_m) {
      result.worst_m = all.back();
      result.worst_index = index;
    }
  }
  if (all.empty()) return result;
  const auto quantile = [&](double share) {
    const auto at = all.begin() + static_cast<std::ptrdiff_t>(share * double(all.size() - 1));
    std::nth_element(all.begin(), at, all.end());
    return *at;
  };
  result.p99_m = quantile(0.99);
  result.median_m = quantile(0.5);
  return result;
}

}  // namespace cellmap
