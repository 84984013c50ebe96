#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <variant>

#include "cellmap/geometry/fibonacci_bands.hpp"
#include "cellmap/geometry/fibonacci_sphere.hpp"
#include "cellmap/geometry/point_cloud.hpp"

namespace cellmap {

/// Which lattice a CELL was made with; part of the file format (FORMAT.md, "Lattices"), so values
/// are never reused and an order, once published, never changes.
enum class LatticeKind : std::uint8_t {
  kFibonacci = 1,
  kFibonacciBands = 2,
};

/// Names one lattice exactly. Two equal specs give the same directions in the same order on every
/// machine.
struct LatticeSpec {
  LatticeKind kind = LatticeKind::kFibonacci;
  /// kFibonacci: the number of lattice points, 1,000 to 1,000,000. kFibonacciBands: N of the bands,
  /// 1,000 to 500,000; Lattice::size() is the number of lattice points.
  std::uint32_t size = 50'000;
  bool operator==(const LatticeSpec&) const = default;

  /// Throws Error{kUnsupported} for a kind or a size this build does not know.
  void validate() const;
};

/// For example "fibonacci-50000" or "fibonacci-bands-50000".
std::string to_string(const LatticeSpec& spec);

/// "fibonacci", "fibonacci-bands", as APIs spell a kind; another kind by its number.
std::string to_string(LatticeKind kind);
/// Throws Error{kUnsupported} for a name that this build does not know.
LatticeKind lattice_kind_from(std::string_view name);

/// A fixed set of directions on the unit sphere. Each lattice point owns the patch of directions
/// that are nearer to it than to any other.
///
/// kFibonacci: the paper's FL (Sec. III-B), nearly uniform over the whole sphere: `size` points of
/// FibonacciSphere beside the poles. kFibonacciBands: the lattice of the paper's released code,
/// three bands of different density that leave the sky out (FibonacciBands). The order of both, and
/// every bit of their directions, is fixed by FORMAT.md, "Lattices".
///
/// Immutable and safe to share between threads.
class Lattice {
 public:
  /// Validates the spec. Takes microseconds and 20 KB for any N of kFibonacci, about 1 ms and 0.4
  /// MB for kFibonacciBands with N = 50,000.
  explicit Lattice(const LatticeSpec& spec);

  const LatticeSpec& spec() const { return spec_; }
  /// The number of directions; not spec().size, which in a lattice of bands names their density.
  std::uint32_t size() const;

  /// Unit direction of lattice point `index` < size().
  Eigen::Vector3d direction(std::uint32_t index) const;

  /// The same of many lattice points, to the same bits, about ten times as fast. Writes as many
  /// numbers to each of `x`, `y` and `z` as there are indices.
  void directions(std::span<const std::uint32_t> indices, double* x, double* y, double* z) const;

  /// The lattice point nearest to a direction of any length > 0: the argmax over all i of
  /// direction(i) . direction, evaluated in double (from left to right, the product along the
  /// lattice's axis last: x x + y y + z z, or x x + z z + y y in kFibonacciBands); the lower index
  /// on a tie. `kNowhere` for a direction that the lattice leaves out, which kFibonacci never does
  /// and kFibonacciBands does where z is at least 0.70 of the length. Constant time.
  std::uint32_t nearest(const Eigen::Vector3d& direction) const;

  /// The same of every point of `cloud`, written to `indices` (same length); `kNowhere` also for
  /// points that are not finite or the origin. Vectorised (simd/nearest.hpp): decided in float
  /// where that is certain, else as above, so the same on every machine. Serial; callers that want
  /// threads split the points.
  void nearest(const PointCloud& cloud, std::span<std::uint32_t> indices) const;
  void nearest(const float* x, const float* y, const float* z,
               std::span<std::uint32_t> indices) const;
  static constexpr std::uint32_t kNowhere = simd::kUndecided;

  /// Mean angular radius of the patches around lattice point `index`: of a disc that has a patch's
  /// mean solid angle, 2 / sqrt(N) rad with N points on a whole sphere of their density.
  double patch_radius_rad(std::uint32_t index) const;
  /// Of the lattice's smallest patches.
  double patch_radius_rad() const;

 private:
  LatticeSpec spec_;
  std::variant<FibonacciSphere, FibonacciBands> points_;
};

/// One immutable lattice per spec, built on first use and shared afterwards; the cache is a value,
/// owned by whoever needs it (a store reader, a server). Thread safe.
class LatticeCache {
 public:
  LatticeCache();
  ~LatticeCache();
  std::shared_ptr<const Lattice> get(const LatticeSpec& spec);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cellmap
