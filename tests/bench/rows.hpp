#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "bench/drive.hpp"
#include "bench/paper_way.hpp"
#include "bench/report.hpp"

namespace cellmap::bench {

/// What all rows share.
struct Setting {
  bool quick = false;
  std::shared_ptr<const Lattice> lattice;
  std::shared_ptr<const LatticeTree> tree;
  std::vector<PosedScan> simulated;  ///< a straight street of the town, true poses
  std::vector<CellPair> pairs;       ///< simulated, and real where the data is there
  std::vector<int> threads;          ///< 1, and 2 where the machine has them

  /// `seconds` in the full run, a tenth of it in the quick one.
  Effort effort(double seconds, int contestant_threads) const {
    Effort effort{.seconds = seconds, .min_pairs = 7, .max_pairs = 200};
    if (quick) {
      effort = {.seconds = seconds / 10, .min_pairs = contestant_threads == 1 ? 3 : 2};
    }
    effort.threads = contestant_threads;
    return effort;
  }
};

/// Throws Error{kInternal} where our figure and the baseline's come from different results: a ratio
/// between things that do not agree says nothing.
void require_agreement(bool holds, const std::string& what);

/// Each measures its rows and hands every one to `add` as soon as it is known.
using AddRow = std::function<void(Row)>;
void nearest_rows(const Setting& setting, const AddRow& add);
void cell_rows(const Setting& setting, const AddRow& add);
void registration_rows(const Setting& setting, const AddRow& add);
void loop_rows(const Setting& setting, const AddRow& add);
void pose_graph_rows(const Setting& setting, const AddRow& add);
void codec_rows(const Setting& setting, const AddRow& add);
void store_rows(const Setting& setting, const AddRow& add);
void ingest_rows(const Setting& setting, const AddRow& add);
/// Among 10^5 and 10^6 places; a tenth of them in the quick run.
void place_rows(const Setting& setting, const AddRow& add);

/// Streams a drive of KITTI 00's length along its route from the simulator (--kitti00).
void kitti00_ingest_row(const AddRow& add);

/// The body of the child process of `ingest_rows`: maps the drive in `folder` and prints the peak
/// of its resident memory in MiB.
int print_peak_memory_of_build(const std::string& folder, int threads);

/// For the row "capacity" of tests/scale: keeps synthetic descriptions of all CELLs of a map in its
/// store, reads them, searches among them with room for all and with room for a quarter, and prints
/// what that takes as JSON.
int print_places_of_store(const std::string& store, const std::string& map);
/// The keeping alone.
int keep_places_of_store(const std::string& store, const std::string& map);

}  // namespace cellmap::bench
