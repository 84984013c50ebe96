#include "cellmap/codec/packed_planes.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <type_traits>

#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

constexpr int kZstdLevel = 9;
constexpr int kMaxDigits = 32;

struct PackedModel {
  IndexModel index;
  std::array<IntegerModel, 3> distance;               ///< by how many neighbours agree
  std::array<std::array<IntegerModel, 3>, 3> normal;  ///< by axis and the same
  std::array<IntegerModel, 3> last;                   ///< the coordinate that the others give
};
using PackedModels = std::array<PackedModel, kPlaneLayers>;

PackedModels first_models() { return {}; }

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

Expected expected(const simd::PatchPredictions& predictions, std::size_t k) {
  const std::array<double, 3> v = {predictions.m[0][k], predictions.m[1][k], predictions.m[2][k]};
  const double norm = std::sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  Expected e;
  e.distance_m = static_cast<float>(kInverseRangeUnit / predictions.w[k]);
  e.last = 0;
  for (int i = 0; i < 3; ++i) {
    e.normal[i] = static_cast<float>(norm > 0 ? -v[i] / norm : 0);
    if (std::abs(v[i]) > std::abs(v[e.last])) e.last = i;
  }
  e.context = std::min(static_cast<int>(predictions.agreeing[k]), 2);
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
  const std::int64_t read = code_integer(coder, model, kMaxDigits, std::int64_t{step}).value;
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
  const double scale = kInverseRangeUnit / (along * double{plane.distance_m});
  InversePlane m = {nx * scale, ny * scale, nz * scale};
  for (double* v : {&m.x, &m.y, &m.z}) {
    if (!(std::abs(*v) < kMaxInverseRange)) return {};
    *v = std::floor(*v + 0.5);
  }
  return m;
}

/// What is kept from plane to plane.
struct PackedState {
  PackedState(CodingLattice& coding_lattice, std::size_t planes)
      : lattice(coding_lattice), known(coding_lattice, planes), index(coding_lattice) {}

  CodingLattice& lattice;
  PackedModels models = first_models();
  KnownPlanes known;
  CodedIndex index;
};

/// Codes the planes of lattice points of one layer; those that are read are validated.
template <typename Coder>
void code_planes(Coder& coder, PackedState& state, PackedModel& model,
                 std::span<const std::uint32_t> indices, std::span<Plane> planes) {
  constexpr bool is_decoder = std::is_same_v<Coder, RangeDecoder>;
  visit_batches(state.lattice, indices, [&](std::size_t first, const PatchBatch& batch) {
    const simd::PatchPredictions& predictions = state.known.predict(batch);
    for (std::size_t k = 0; k < batch.count; ++k) {
      if (state.known.is_guess(k)) state.known.guess(batch, k);
      code_plane(coder, model, expected(predictions, k), planes[first + k]);
      if (is_decoder) validate_plane(planes[first + k], batch.direction(k), indices[first + k]);
      state.known.add(batch, k, to_inverse(planes[first + k], batch.direction(k)));
    }
    if constexpr (is_decoder) coder.check();
  });
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

/// The first coded bits say how long a zstd frame of the shuffled planes after the stream is; 0:
/// the planes are in the stream.
CodedLayer encode_layer(PackedState& state, int layer, std::span<const std::uint32_t> indices,
                        std::span<Plane> planes) {
  PackedModel& model = state.models[static_cast<std::size_t>(layer)];
  const PackedModel model_before = model;
  const std::vector<std::uint8_t> any_before = state.index.was_any;
  CodedLayer coded;
  coded.planes = planes.size();
  RangeEncoder predicted;
  predicted.bits(32, 0);
  code_index(predicted, model.index, state.lattice, layer, state.index);
  code_planes(predicted, state, model, indices, planes);
  coded.bytes = std::move(predicted).finish();
  if (coded.bytes.size() < sizeof(Plane) * planes.size() / 2) return coded;  // zstd gets nowhere
  const Bytes frame = zstd_compress(shuffled(planes), kZstdLevel);
  model = model_before;
  state.index.was_any = any_before;
  RangeEncoder index_only;
  index_only.bits(32, static_cast<std::uint32_t>(frame.size()));
  code_index(index_only, model.index, state.lattice, layer, state.index);
  Bytes other = std::move(index_only).finish();
  other.insert(other.end(), frame.begin(), frame.end());
  if (other.size() < coded.bytes.size()) coded.bytes = std::move(other);
  return coded;
}

void decode_layer(PackedState& state, int layer, const LayerView& view) {
  PackedModel& model = state.models[static_cast<std::size_t>(layer)];
  RangeDecoder size_only(view.bytes);
  const std::size_t frame_size = size_only.bits(32);
  if (frame_size > view.bytes.size()) {
    throw Error(ErrorCode::kCorruptData, "the packed planes name a frame of " +
                                             std::to_string(frame_size) + " bytes, but have " +
                                             std::to_string(view.bytes.size()));
  }
  RangeDecoder coder(view.bytes.first(view.bytes.size() - frame_size));
  coder.bits(32);
  code_index(coder, model.index, state.lattice, layer, state.index);
  coder.check();
  DecodedPlanes& decoded = state.lattice.memory.layers[static_cast<std::size_t>(layer)];
  std::swap(decoded.indices, state.index.of_layer);
  check_count(decoded.indices, view.planes);
  if (frame_size > 0) {
    const std::size_t most = sizeof(Plane) * std::max<std::size_t>(view.planes, 1);
    decoded.planes = unshuffled(zstd_decompress(view.bytes.last(frame_size), most), view.planes);
    // The stream knows nothing of these planes, but planes of the next layer are next to them.
    visit_batches(state.lattice, decoded.indices, [&](std::size_t first, const PatchBatch& batch) {
      for (std::size_t k = 0; k < batch.count; ++k) {
        const Plane& plane = decoded.planes[first + k];
        validate_plane(plane, batch.direction(k), decoded.indices[first + k]);
        state.known.add(batch, k, to_inverse(plane, batch.direction(k)));
      }
    });
  } else {
    decoded.planes.resize(view.planes);
    code_planes(coder, state, model, decoded.indices, decoded.planes);
  }
  coder.finish();
}

}  // namespace

CodedLayers encode_packed_planes(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                                 std::span<const Plane> planes) {
  PackedState state(lattice, planes.size());
  state.index.has_plane.resize(lattice.lattice.size());
  for (const std::uint32_t index : indices) state.index.has_plane[index] = 1;
  CodedLayers layers;
  for (int layer = 0; layer < kPlaneLayers; ++layer) {
    std::vector<std::uint32_t> of_layer;
    std::vector<Plane> planes_of_layer;
    visit_points(lattice, indices, [&](std::size_t k, std::size_t, std::uint32_t point) {
      if (layer_of(point) != layer) return;
      of_layer.push_back(indices[k]);
      planes_of_layer.push_back(planes[k]);
    });
    layers[layer] = encode_layer(state, layer, of_layer, planes_of_layer);
  }
  return layers;
}

DecodedPlanes decode_packed_planes(CodingLattice& lattice, std::span<const LayerView> layers) {
  std::size_t planes = 0;
  for (const LayerView& layer : layers) planes += layer.planes;
  PackedState state(lattice, planes);
  for (std::size_t layer = 0; layer < layers.size(); ++layer) {
    decode_layer(state, static_cast<int>(layer), layers[layer]);
  }
  return merged_layers(lattice, layers.size());
}

}  // namespace cellmap
