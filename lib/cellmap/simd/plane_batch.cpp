#include "cellmap/simd/plane_batch.hpp"

// Compiles the rest of this file once for each instruction set.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cellmap/simd/plane_batch.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace cellmap::simd::HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;
using D = hn::CappedTag<double, PlaneBatch::kSize>;
using VD = hn::Vec<D>;

HWY_INLINE VD constant(double value) { return hn::Set(D(), value); }

/// The smallest root of x^3 - x^2 + c1 x - determinant, see `smallest_eigenvalue`.
struct Cubic {
  VD c1, determinant;

  HWY_INLINE VD value(VD x) const {
    return hn::Sub(hn::Mul(hn::Add(hn::Mul(hn::Sub(x, constant(1)), x), c1), x), determinant);
  }
  HWY_INLINE VD slope(VD x) const {
    return hn::Add(hn::Mul(hn::Sub(hn::Mul(constant(3), x), constant(2)), x), c1);
  }
};

/// Smallest eigenvalue of a symmetric positive semi-definite matrix of trace 1: the smallest root
/// of p(x) = x^3 - x^2 + c1 x - determinant. p is concave up to 1/3, where the smallest root lies,
/// so Newton's method takes any start there to or below the root, and from below it rises without
/// overshooting. Started from the root of p without its cube, which is near where planes are flat.
HWY_INLINE VD smallest_eigenvalue(const Cubic& p) {
  constexpr int kMaxSteps = 60;
  const D d;
  const VD zero = hn::Zero(d);
  const VD discriminant = hn::Sub(hn::Mul(p.c1, p.c1), hn::Mul(constant(4), p.determinant));
  VD x = hn::Div(hn::Mul(constant(2), p.determinant),
                 hn::Add(p.c1, hn::Sqrt(hn::Max(discriminant, zero))));
  x = hn::Sub(x, hn::Div(p.value(x), p.slope(x)));
  const auto usable =
      hn::And(hn::Gt(discriminant, zero), hn::And(hn::Gt(x, zero), hn::Le(x, constant(1.0 / 3))));
  x = hn::IfThenElseZero(usable, x);
  auto rising = hn::Eq(zero, zero);
  for (int step = 0; step < kMaxSteps; ++step) {
    const VD value = p.value(x), slope = p.slope(x);
    const VD next = hn::Sub(x, hn::Div(value, slope));
    rising = hn::And(hn::And(rising, hn::And(hn::Lt(value, zero), hn::Gt(slope, zero))),
                     hn::Gt(next, x));
    if (hn::AllFalse(d, rising)) break;
    x = hn::IfThenElse(rising, next, x);
  }
  return x;
}

struct Vector {
  VD x, y, z;
};

HWY_INLINE Vector cross(const Vector& a, const Vector& b) {
  return {hn::Sub(hn::Mul(a.y, b.z), hn::Mul(a.z, b.y)),
          hn::Sub(hn::Mul(a.z, b.x), hn::Mul(a.x, b.z)),
          hn::Sub(hn::Mul(a.x, b.y), hn::Mul(a.y, b.x))};
}

HWY_INLINE VD squared_norm(const Vector& v) {
  return hn::Add(hn::Mul(v.x, v.x), hn::Add(hn::Mul(v.y, v.y), hn::Mul(v.z, v.z)));
}

HWY_INLINE Vector longer(const Vector& a, const Vector& b) {
  const auto is_b = hn::Gt(squared_norm(b), squared_norm(a));
  return {hn::IfThenElse(is_b, b.x, a.x), hn::IfThenElse(is_b, b.y, a.y),
          hn::IfThenElse(is_b, b.z, a.z)};
}

/// Covariance, row by row from the diagonal on.
struct Covariance {
  VD xx, xy, xz, yy, yz, zz;

  HWY_INLINE VD trace() const { return hn::Add(xx, hn::Add(yy, zz)); }
  /// The sum of the principal minors.
  HWY_INLINE VD minors() const {
    VD sum = hn::Sub(hn::Mul(xx, yy), hn::Mul(xy, xy));
    sum = hn::Sub(hn::Add(sum, hn::Mul(xx, zz)), hn::Mul(xz, xz));
    return hn::Sub(hn::Add(sum, hn::Mul(yy, zz)), hn::Mul(yz, yz));
  }
  HWY_INLINE VD determinant() const {
    const VD a = hn::Mul(xx, hn::Sub(hn::Mul(yy, zz), hn::Mul(yz, yz)));
    const VD b = hn::Mul(xy, hn::Sub(hn::Mul(xy, zz), hn::Mul(yz, xz)));
    const VD c = hn::Mul(xz, hn::Sub(hn::Mul(xy, yz), hn::Mul(yy, xz)));
    return hn::Add(hn::Sub(a, b), c);
  }
  /// The longest direction that the matrix minus `eigenvalue` takes to zero.
  HWY_INLINE Vector null_direction(VD eigenvalue) const {
    const Vector a{hn::Sub(xx, eigenvalue), xy, xz}, b{xy, hn::Sub(yy, eigenvalue), yz},
        c{xz, yz, hn::Sub(zz, eigenvalue)};
    return longer(longer(cross(a, b), cross(b, c)), cross(c, a));
  }
};

void fit_at(std::size_t k, PlaneBatch& batch) {
  const D d;
  const VD count = hn::LoadU(d, &batch.count[k]);
  const VD inverse_count = hn::Div(constant(1), count);
  VD mean[3], product[6];
  for (std::size_t i = 0; i < 3; ++i) {
    mean[i] = hn::Mul(hn::LoadU(d, &batch.sum[i][k]), inverse_count);
    hn::StoreU(mean[i], d, &batch.mean[i][k]);
  }
  std::size_t entry = 0;
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = i; j < 3; ++j, ++entry) {
      product[entry] = hn::Sub(hn::Mul(hn::LoadU(d, &batch.products[entry][k]), inverse_count),
                               hn::Mul(mean[i], mean[j]));
    }
  }
  const VD trace =
      Covariance{product[0], product[1], product[2], product[3], product[4], product[5]}.trace();
  for (VD& value : product) value = hn::Div(value, trace);
  const Covariance A{product[0], product[1], product[2], product[3], product[4], product[5]};
  const VD c1 = A.minors();
  const VD smallest = smallest_eigenvalue({c1, A.determinant()});
  const Vector normal = A.null_direction(smallest);
  const VD norm = hn::Sqrt(squared_norm(normal));
  // A has trace 1, so this is relative: below it the two smaller eigenvalues are the same number.
  const auto is_plane = hn::And(hn::And(hn::Ge(count, constant(3)), hn::Gt(trace, hn::Zero(d))),
                                hn::Gt(norm, constant(1e-13)));
  hn::StoreU(hn::IfThenElseZero(is_plane, hn::Div(normal.x, norm)), d, &batch.normal[0][k]);
  hn::StoreU(hn::IfThenElseZero(is_plane, hn::Div(normal.y, norm)), d, &batch.normal[1][k]);
  hn::StoreU(hn::IfThenElseZero(is_plane, hn::Div(normal.z, norm)), d, &batch.normal[2][k]);
  // The other two eigenvalues have the sum 1 - smallest and the product c1 - smallest (1 - it).
  const VD sum = hn::Sub(constant(1), smallest);
  const VD rest = hn::Sub(c1, hn::Mul(smallest, sum));
  const VD difference = hn::Sub(hn::Mul(sum, sum), hn::Mul(constant(4), rest));
  const VD middle =
      hn::Mul(hn::Sub(sum, hn::Sqrt(hn::Max(hn::Zero(d), difference))), constant(0.5));
  hn::StoreU(hn::Mul(smallest, trace), d, &batch.variance_across[k]);
  hn::StoreU(hn::Mul(middle, trace), d, &batch.variance_within[k]);
}

void FitPlanes(PlaneBatch& batch) {
  for (std::size_t k = 0; k < batch.used; k += hn::Lanes(D())) fit_at(k, batch);
}

}  // namespace
}  // namespace cellmap::simd::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace cellmap::simd {

HWY_EXPORT(FitPlanes);

void PlaneBatch::set(std::size_t k, const Moments& moments) {
  count[k] = moments.count;
  for (std::size_t i = 0; i < 3; ++i) sum[i][k] = moments.sum[i];
  for (std::size_t i = 0; i < 6; ++i) products[i][k] = moments.products[i];
}

void fit_planes(PlaneBatch& batch) { HWY_DYNAMIC_DISPATCH(FitPlanes)(batch); }

}  // namespace cellmap::simd
#endif
