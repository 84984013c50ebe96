#include "cellmap/pipeline/build_map.hpp"

#include <atomic>

#include "cellmap/pipeline/make_cells.hpp"

namespace cellmap {

void build_map(ScanSource& source, Mapper& mapper, const std::function<void(CellUpdate&&)>& sink,
               const std::stop_token& stop, const ProgressCallback& progress) {
  std::atomic<std::size_t> scans_done = 0, cells_done = 0;
  const auto tell = [&] {
    if (progress) progress({scans_done, source.size(), cells_done});
  };
  const auto hand_on = [&](CellUpdate&& update) {
    sink(std::move(update));
    ++cells_done;
  };
  const CellSink cells{[&](FinishedCell&& cell) { hand_on(mapper.integrate(std::move(cell))); },
                       [&](const PosedScan& scan) {
                         scans_done = scan.index + 1;
                         tell();
                       }};
  make_cells(source, mapper.front_end(), mapper.options().build.threads != 1, cells, stop);
  if (auto update = mapper.finish()) hand_on(std::move(*update));
  tell();
}

}  // namespace cellmap
