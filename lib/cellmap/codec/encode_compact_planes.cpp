#include <bit>
#include <cmath>
#include <utility>

#include "cellmap/codec/compact_model.hpp"
#include "cellmap/codec/compact_planes.hpp"
#include "cellmap/codec/plane_displacement.hpp"

namespace cellmap {
namespace {

// The encoder tries scales from kCoarser above the ideal one on, where that is kWorthSaying. Half
// octaves.
constexpr double kCoarser = 1, kWorthSaying = 2.5;

/// Chooses what is written of a plane: the coarsest steps that hold the bound.
class PlaneEncoder {
 public:
  /// What is rebuilt of patch `k` is that of the plane chosen last.
  PlaneEncoder(const PatchBatch& batch, std::size_t k, RebuiltBatch& rebuilt,
               const PlaneContext& context, double radius_rad, double bound_m)
      : batch_(batch),
        k_(k),
        rebuilt_(rebuilt),
        context_(context),
        radius_rad_(radius_rad),
        bound_m_(bound_m) {}

  CodedPlane encode(const Plane& plane) {
    const LeaningPlane source = {plane.distance_m, slope(plane, batch_.frames.t1),
                                 slope(plane, batch_.frames.t2)};
    const double ideal = 2 * std::log2(source.secant() / context_.secant());
    // Less than an octave coarser does not pay for saying so.
    int scale =
        ideal < kWorthSaying
            ? 0
            : static_cast<int>(std::lround(std::min<double>(ideal + kCoarser, kCoarsestScale)));
    for (; scale >= kFinestScale; --scale) {
      CodedPlane candidate;
      candidate.scale = scale;
      if (round_at(source, candidate) && serves(plane, candidate)) return candidate;
    }
    CodedPlane escape;
    escape.raw = {std::bit_cast<std::uint32_t>(plane.distance_m),
                  std::bit_cast<std::uint32_t>(plane.nx), std::bit_cast<std::uint32_t>(plane.ny),
                  std::bit_cast<std::uint32_t>(plane.nz)};
    return escape;
  }

 private:
  double slope(const Plane& plane, const simd::PatchVectors& t) const {
    const Eigen::Vector3d n(plane.nx, plane.ny, plane.nz);
    return (n.x() * t[0][k_] + n.y() * t[1][k_] + n.z() * t[2][k_]) / n.dot(batch_.direction(k_));
  }
  static bool round(double value, double step, std::int64_t& steps) {
    const double exact = value / step;
    if (!(std::abs(exact) < (1 << kMaxStepDigits) - 1)) return false;
    steps = std::llround(exact);
    return true;
  }
  bool round_at(const LeaningPlane& source, CodedPlane& coded) const {
    const LeaningPlane expected = context_.expected();
    const double step = context_.range_step(coded.scale);
    if (!round(source.range_m - expected.range_m, step, coded.range)) return false;
    const double range_m = context_.range_m(coded);
    if (!(range_m > 0)) return false;
    const double slope_step = context_.slope_step(coded.scale, range_m);
    return round(source.s1 - expected.s1, slope_step, coded.s1) &&
           round(source.s2 - expected.s2, slope_step, coded.s2);
  }
  bool serves(const Plane& plane, const CodedPlane& coded) {
    const LeaningPlane candidate = context_.rebuilt(coded);
    if (!candidate.is_valid()) return false;
    rebuilt_.set(k_, candidate);
    rebuilt_.rebuild(batch_, k_, k_ + 1);
    return plane_displacement_m(plane, rebuilt_.plane(k_), batch_.direction(k_), radius_rad_) <=
           bound_m_;
  }

  const PatchBatch& batch_;
  std::size_t k_;
  RebuiltBatch& rebuilt_;
  const PlaneContext& context_;
  double radius_rad_, bound_m_;
};

/// Counts instead of writing.
class BitCounter {
 public:
  BitCounter(CompactModels& models, BitCounts& counts)
      : first_(bit_models(models).data()), counts_(&counts) {
    counts.resize(bit_models(models).size());
  }
  bool bit(BitModel& model, bool value) {
    ++(*counts_)[static_cast<std::size_t>(&model - first_)][value];
    model.learn(value);
    return value;
  }
  bool plain_bit(bool value) { return value; }
  std::uint32_t bits(int, std::uint32_t value) { return value; }

 private:
  const BitModel* first_;
  BitCounts* counts_;
};

/// Returns how many planes it has.
template <typename Coder>
std::size_t encode_layer(Coder& coder, CompactState& state, int layer,
                         std::span<const std::uint32_t> indices, std::span<const Plane> planes,
                         double bound_m) {
  CompactModel& model = state.models[static_cast<std::size_t>(layer)];
  code_index(coder, model.index, state.lattice, layer, state.index);
  std::vector<std::uint32_t> of_layer;
  std::vector<const Plane*> planes_of_layer;
  visit_points(state.lattice, indices, [&](std::size_t k, std::size_t, std::uint32_t point) {
    if (layer_of(point) != layer) return;
    of_layer.push_back(indices[k]);
    planes_of_layer.push_back(&planes[k]);
  });
  BatchContext contexts;
  RebuiltBatch rebuilt;
  visit_batches(state.lattice, of_layer, [&](std::size_t first, const PatchBatch& batch) {
    const double radius_rad = state.lattice.spheres[batch.sphere].patch_radius_rad();
    const StepRule& rule = state.rules[batch.sphere];
    const simd::PatchPredictions& predictions = state.known.predict(batch);
    contexts.set(predictions, rule, 0, batch.count);
    for (std::size_t k = 0; k < batch.count; ++k) {
      if (state.known.is_guess(k)) {
        state.known.guess(batch, k);
        contexts.set(predictions, rule, k, k + 1);
      }
      const PlaneContext context(contexts, k, rule);
      CodedPlane coded = PlaneEncoder(batch, k, rebuilt, context, radius_rad, bound_m)
                             .encode(*planes_of_layer[first + k]);
      code_plane(coder, model, state.version, context, coded);
      if (coded.scale != kEscapeScale) rebuilt.add_to(state.known, batch, k);
    }
  });
  return of_layer.size();
}

CompactState state_to_encode(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                             double bound_m) {
  CompactState state(lattice, indices.size(), bound_m, CompactVersion::k2);
  state.index.has_plane.resize(lattice.lattice.size());
  for (const std::uint32_t index : indices) state.index.has_plane[index] = 1;
  return state;
}

}  // namespace

CodedLayers encode_compact_planes(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                                  std::span<const Plane> planes, double bound_m) {
  CompactState state = state_to_encode(lattice, indices, bound_m);
  CodedLayers layers;
  for (int layer = 0; layer < kPlaneLayers; ++layer) {
    RangeEncoder coder;
    layers[layer].planes = encode_layer(coder, state, layer, indices, planes, bound_m);
    layers[layer].bytes = std::move(coder).finish();
  }
  return layers;
}

void count_compact_bits(CodingLattice& lattice, std::span<const std::uint32_t> indices,
                        std::span<const Plane> planes, double bound_m, BitCounts& counts) {
  CompactState state = state_to_encode(lattice, indices, bound_m);
  BitCounter counter(state.models, counts);
  for (int layer = 0; layer < kPlaneLayers; ++layer) {
    encode_layer(counter, state, layer, indices, planes, bound_m);
  }
}

}  // namespace cellmap
