#include <array>
#include <bit>
#include <utility>

#include "cellmap/codec/compact_model.hpp"
#include "cellmap/codec/compact_planes.hpp"
#include "cellmap/core/error.hpp"

namespace cellmap {
namespace {

/// Decodes the planes of one layer, a batch at a time.
class LayerDecoder {
 public:
  /// Into `decoded.planes`; the indices are there.
  LayerDecoder(RangeDecoder& coder, CompactState& state, CompactModel& model,
               DecodedPlanes& decoded)
      : coder_(coder), state_(state), model_(model), decoded_(decoded) {}

  void decode(std::size_t first, const PatchBatch& batch) {
    const StepRule& rule = state_.rules[batch.sphere];
    const simd::PatchPredictions& predictions = state_.known.predict(batch);
    contexts_.set(predictions, rule, 0, batch.count);
    RangeDecoder coder = coder_;  // where nobody else sees it, so that it is kept in registers
    std::size_t settled = 0;
    for (std::size_t k = 0; k < batch.count; ++k) {
      if (state_.known.is_guess(k)) {  // from the plane before, which must be known for it
        settle(first, batch, settled, k);
        settled = k;
        state_.known.guess(batch, k);
        contexts_.set(predictions, rule, k, k + 1);
      }
      decode_numbers(coder, PlaneContext(contexts_, k, rule), first, k);
    }
    settle(first, batch, settled, batch.count);
    coder_ = coder;
    coder_.check();
  }

 private:
  [[gnu::always_inline]] void decode_numbers(RangeDecoder& coder, const PlaneContext& context,
                                             std::size_t first, std::size_t k) {
    CodedPlane coded;
    code_plane(coder, model_, state_.version, context, coded);
    is_kept_[k] = coded.scale == kEscapeScale;
    if (is_kept_[k]) {
      decoded_.planes[first + k] = {
          std::bit_cast<float>(coded.raw[0]), std::bit_cast<float>(coded.raw[1]),
          std::bit_cast<float>(coded.raw[2]), std::bit_cast<float>(coded.raw[3])};
      return;
    }
    const LeaningPlane plane = context.rebuilt(coded);
    if (!plane.is_valid()) throw Error(ErrorCode::kCorruptData, "a coded plane is out of range");
    rebuilt_.set(k, plane);
  }

  void settle(std::size_t first, const PatchBatch& batch, std::size_t begin, std::size_t end) {
    rebuilt_.rebuild(batch, begin, end);
    for (std::size_t k = begin; k < end; ++k) {
      Plane& plane = decoded_.planes[first + k];
      if (!is_kept_[k]) {
        plane = rebuilt_.plane(k);
        rebuilt_.add_to(state_.known, batch, k);
      }
      validate_plane(plane, batch.direction(k), decoded_.indices[first + k]);
    }
  }

  RangeDecoder& coder_;
  CompactState& state_;
  CompactModel& model_;
  DecodedPlanes& decoded_;
  std::array<bool, simd::kMostPatches> is_kept_{};
  BatchContext contexts_;
  RebuiltBatch rebuilt_;
};

void decode_layer(CompactState& state, std::size_t layer, const LayerView& view) {
  CompactModel& model = state.models[layer];
  RangeDecoder coder(view.bytes);
  code_index(coder, model.index, state.lattice, static_cast<int>(layer), state.index);
  coder.check();
  DecodedPlanes& decoded = state.lattice.memory.layers[layer];
  std::swap(decoded.indices, state.index.of_layer);
  check_count(decoded.indices, view.planes);
  decoded.planes.resize(decoded.indices.size());
  LayerDecoder decoder(coder, state, model, decoded);
  visit_batches(state.lattice, decoded.indices,
                [&](std::size_t first, const PatchBatch& batch) { decoder.decode(first, batch); });
  coder.finish();
}

}  // namespace

DecodedPlanes decode_compact_planes(CodingLattice& lattice, std::span<const LayerView> layers,
                                    double bound_m, CompactVersion version) {
  std::size_t planes = 0;
  for (const LayerView& layer : layers) planes += layer.planes;
  CompactState state(lattice, planes, bound_m, version);
  for (std::size_t layer = 0; layer < layers.size(); ++layer) {
    decode_layer(state, layer, layers[layer]);
  }
  return merged_layers(lattice, layers.size());
}

}  // namespace cellmap
