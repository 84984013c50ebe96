#include "cellmap/pipeline/build_map.hpp"

namespace cellmap {

void build_map(ScanSource& source, Mapper& mapper, const std::function<void(CellUpdate&&)>& sink,
               const std::stop_token& stop, const ProgressCallback& progress) {
  Progress state;
  state.scans_total = source.size();
  const auto hand_on = [&](std::optional<CellUpdate> update) {
    if (!update) return;
    sink(std::move(*update));
    ++state.cells_done;
  };
  while (auto scan = source.next()) {
    throw_if_stopped(stop);
    hand_on(mapper.add(*scan));
    state.scans_done = scan->index + 1;
    if (progress) progress(state);
  }
  hand_on(mapper.finish());
  if (progress) progress(state);
}

}  // namespace cellmap
