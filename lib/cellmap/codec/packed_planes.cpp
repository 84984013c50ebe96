#include "cellmap/codec/packed_planes.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

#include "cellmap/codec/index_coding.hpp"
#include "cellmap/codec/plane_prediction.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr int kZstdLevel = 9;
constexpr int kMaxDigits = 32;

struct PackedModel {
  std::array<IntegerModel, 3> distance;               ///< by how many neighbours agree
  std::array<std::array<IntegerModel, 3>, 3> normal;  ///< by axis and the same
  std::array<IntegerModel, 3> last;                   ///< the coordinate that the others give
};

/// Floats in their order as integers in their order, each its own (IEEE totalOrder).
std::uint32_t ordered(float value) {
  const auto bits = std::bit_cast<std::uint32_t>(value);
  return bits >> 31 ? ~bits : bits | 0x80000000u;
}
float from_ordered(std::uint32_t order) {
  return std::bit_cast<float>(order >> 31 ? order & 0x7fffffffu : ~order);
}

/// What the planes around a patch let one expect.
struct Expected {
  float distance_m;
  std::array<float, 3> normal;
  int context;  ///< 0 to 2: none, one or more planes agree
  int last;     ///< axis of the coordinate that follows from the other two
};

Expected expected(const PlanePrediction& prediction, const InversePlane& m) {
  const std::array<double, 3> v = {double(m.x), double(m.y), double(m.z)};
  const double norm = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  Expected e;
  e.distance_m =
      static_cast<float>(std::ldexp(1.0, kInverseRangeBits) / double(prediction.plane.w));
  e.last = 0;
  for (int i = 0; i < 3; ++i) {
    e.normal[i] = static_cast<float>(norm > 0 ? -v[i] / norm : 0);
    if (std::abs(v[i]) > std::abs(v[e.last])) e.last = i;
  }
  e.context = std::min(prediction.agreeing, 2);
  return e;
}

/// The coordinate of a unit vector whose other two are known, with the sign of `sign`.
float remaining(float a, float b, float sign) {
  const double rest = std::max(0.0, 1 - double{a} * double{a} - double{b} * double{b});
  return static_cast<float>(std::copysign(std::sqrt(rest), double{sign}));
}

template <typename Coder>
float code_float(Coder& coder, IntegerModel& model, float expected, float value) {
  const std::uint32_t from = ordered(expected);
  const auto step = static_cast<std::int32_t>(ordered(value) - from);  // modulo 2^32
  const std::int64_t read = code_integer(coder, model, kMaxDigits, std::int64_t{step});
  return from_ordered(from + static_cast<std::uint32_t>(read));
}

template <typename Coder>
void code_plane(Coder& coder, PackedModel& model, const Expected& e, Plane& plane) {
  plane.distance_m = code_float(coder, model.distance[e.context], e.distance_m, plane.distance_m);
  std::array<float*, 3> n = {&plane.nx, &plane.ny, &plane.nz};
  for (int i = 0; i < 3; ++i) {
    if (i != e.last) *n[i] = code_float(coder, model.normal[i][e.context], e.normal[i], *n[i]);
  }
  const float a = *n[(e.last + 1) % 3], b = *n[(e.last + 2) % 3];
  *n[e.last] = code_float(coder, model.last[e.last], remaining(a, b, e.normal[e.last]), *n[e.last]);
}

/// m of a plane as neighbours see it; all zeros, which no patch is predicted by, where it is out of
/// range.
InversePlane to_inverse(const Plane& plane, const Eigen::Vector3d& u) {
  const double nx = plane.nx, ny = plane.ny, nz = plane.nz;
  const double along = nx * u.x() + ny * u.y() + nz * u.z();
  const double scale = std::ldexp(1.0, kInverseRangeBits) / (along * double{plane.distance_m});
  std::array<std::int64_t, 3> m;
  const std::array<double, 3> v = {nx * scale, ny * scale, nz * scale};
  for (int i = 0; i < 3; ++i) {
    if (!(std::abs(v[i]) < static_cast<double>(kMaxInverseRange))) return {};
    m[i] = static_cast<std::int64_t>(std::floor(v[i] + 0.5));
  }
  return {m[0], m[1], m[2]};
}

template <typename Coder>
void code_planes(Coder& coder, const Lattice& lattice, const std::vector<LatticeSphere>& spheres,
                 std::span<const std::uint32_t> indices, std::span<Plane> planes) {
  PackedModel model;
  KnownPlanes known(spheres, planes.size());
  for (std::size_t k = 0; k < planes.size(); ++k) {
    const PatchFrame frame(lattice.direction(indices[k]));
    known.move_to(indices[k]);
    const PlanePrediction prediction = known.predict(frame);
    code_plane(coder, model, expected(prediction, frame.to_cell(prediction.plane)), planes[k]);
    known.add(to_inverse(planes[k], frame.direction));
    if constexpr (requires { coder.check(); }) coder.check();
  }
}

Bytes shuffled(std::span<const Plane> planes) {
  const auto bytes = std::as_bytes(planes);
  Bytes result;
  result.reserve(bytes.size());
  for (std::size_t column = 0; column < sizeof(Plane); ++column) {
    for (std::size_t k = 0; k < planes.size(); ++k) {
      result.push_back(bytes[k * sizeof(Plane) + column]);
    }
  }
  return result;
}

std::vector<Plane> unshuffled(std::span<const std::byte> bytes, std::size_t count) {
  if (bytes.size() != count * sizeof(Plane)) {
    throw Error(ErrorCode::kCorruptData, "the shuffled planes have " +
                                             std::to_string(bytes.size()) + " bytes, expected " +
                                             std::to_string(count * sizeof(Plane)));
  }
  std::vector<Plane> planes(count);
  const auto target = std::as_writable_bytes(std::span(planes));
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    target[i % count * sizeof(Plane) + i / count] = bytes[i];
  }
  return planes;
}

template <typename Coder>
void code_packed_index(Coder& coder, const std::vector<LatticeSphere>& spheres,
                       std::vector<std::uint8_t>& has_plane) {
  IndexModel model;
  code_index(coder, model, spheres, has_plane);
}

}  // namespace

// The first coded bit says whether the planes follow in the same stream (0) or after it, shuffled
// in a zstd frame (1); the length of the stream is then in its way told by the frame's.
Bytes encode_packed_planes(const LatticeSpec& spec, std::span<const std::uint32_t> indices,
                           std::span<const Plane> planes) {
  const Lattice lattice(spec);
  const std::vector<LatticeSphere> spheres = spheres_of(lattice);
  std::vector<std::uint8_t> has_plane(lattice.size());
  for (const std::uint32_t index : indices) has_plane[index] = 1;
  std::vector<Plane> copy(planes.begin(), planes.end());
  RangeEncoder predicted;
  predicted.bits(32, 0);
  code_packed_index(predicted, spheres, has_plane);
  code_planes(predicted, lattice, spheres, indices, copy);
  Bytes bytes = std::move(predicted).finish();
  if (bytes.size() < sizeof(Plane) * planes.size() / 2) return bytes;  // zstd never gets there
  const Bytes frame = zstd_compress(shuffled(planes), kZstdLevel);
  RangeEncoder index_only;
  index_only.bits(32, static_cast<std::uint32_t>(frame.size()));
  code_packed_index(index_only, spheres, has_plane);
  Bytes other = std::move(index_only).finish();
  other.insert(other.end(), frame.begin(), frame.end());
  return other.size() < bytes.size() ? other : bytes;
}

DecodedPlanes decode_packed_planes(const LatticeSpec& spec, std::size_t count,
                                   std::span<const std::byte> bytes) {
  const Lattice lattice(spec);
  const std::vector<LatticeSphere> spheres = spheres_of(lattice);
  RangeDecoder size_only(bytes);
  const std::size_t frame_size = size_only.bits(32);
  if (frame_size > bytes.size()) {
    throw Error(ErrorCode::kCorruptData, "the packed planes name a frame of " +
                                             std::to_string(frame_size) + " bytes, but have " +
                                             std::to_string(bytes.size()));
  }
  RangeDecoder coder(bytes.first(bytes.size() - frame_size));
  coder.bits(32);
  std::vector<std::uint8_t> has_plane(lattice.size());
  code_packed_index(coder, spheres, has_plane);
  coder.check();
  DecodedPlanes result{.indices = indices_of(has_plane, count), .planes = {}};
  if (frame_size > 0) {
    coder.finish();
    result.planes = unshuffled(
        zstd_decompress(bytes.last(frame_size), sizeof(Plane) * std::max<std::size_t>(count, 1)),
        count);
  } else {
    result.planes.resize(count);
    code_planes(coder, lattice, spheres, result.indices, result.planes);
    coder.finish();
  }
  return result;
}

}  // namespace cellmap
