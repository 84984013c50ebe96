#include <malloc.h>

#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>

#include "bench/rows.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/pipeline/build_map.hpp"
#include "cellmap/pipeline/make_cells.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::bench {
namespace {

constexpr double kRealTimeScansPerS = 10.0;
constexpr const char* kMap = "bench";
constexpr std::size_t kQuickScans = 60;
/// So many that the vehicle is back on its first street and closes loops.
constexpr std::size_t kFullScans = 600;
/// Of a drive that does not fit memory: the simulator and the mapper take turns.
constexpr std::size_t kScansAPart = 100;

MapperOptions mapper_options(int threads) {
  MapperOptions options;
  options.build.threads = threads;
  options.registration.threads = threads;
  options.loops.registration.threads = threads;
  options.pose_graph.threads = threads;
  return options;
}

/// Counts what a mapper hands out.
struct Counts {
  std::size_t cells = 0, loops = 0;

  void add(const CellUpdate& update) {
    ++cells;
    for (const Constraint& c : update.constraints) loops += c.kind == ConstraintKind::kLoop;
  }
};

/// Maps scans; keeps the CELLs in memory.
Counts map_in_memory(const std::vector<PosedScan>& scans, std::shared_ptr<const Lattice> lattice,
                     int threads) {
  std::map<CellId, std::shared_ptr<const RegistrationTarget>> targets;
  Mapper mapper(mapper_options(threads), "bench", lattice, {},
                {[&](CellId id) { return targets.at(id); }});
  Counts counts;
  MemorySource source(scans);
  build_map(source, mapper, [&](CellUpdate&& update) {
    counts.add(update);
    targets[update.id] = std::make_shared<const RegistrationTarget>(update.cell, lattice);
  });
  return counts;
}

std::vector<PosedScan> next_scans(ScanSource& source, std::size_t count) {
  std::vector<PosedScan> scans;
  while (scans.size() < count) {
    auto scan = source.next();
    if (!scan) break;
    scans.push_back(std::move(*scan));
  }
  return scans;
}

/// Maps scans into an SQLite store, as `cellmap build` does; memory does not hold the CELLs.
class MapInStore {
 public:
  explicit MapInStore(int threads)
      : store_(open_sqlite_store(folder_ / "map.db")),
        lattice_(std::make_shared<const Lattice>(store_->create_map(kMap, {}).lattice)),
        mapper_(mapper_options(threads), "bench", lattice_, {},
                {[this](CellId id) { return load(id); }}) {}

  /// Maps the scans and returns when their CELLs are stored.
  void add(ScanSource& scans) {
    make_cells(scans, mapper_.front_end(), mapper_.options().build.threads != 1,
               {[this](FinishedCell&& cell) { keep(mapper_.integrate(std::move(cell))); }});
  }
  void finish() {
    if (const auto update = mapper_.finish()) keep(*update);
  }
  const Counts& counts() const { return counts_; }

 private:
  std::shared_ptr<const RegistrationTarget> load(CellId id) const {
    auto cell = decode_cell(zstd_decompress(*store_->compressed_cell(kMap, id), kMaxCellBytes));
    return std::make_shared<const RegistrationTarget>(std::make_shared<const Cell>(std::move(cell)),
                                                      lattice_);
  }

  void keep(const CellUpdate& update) {
    counts_.add(update);
    store_->commit(kMap, to_map_update(update));
  }

  const test::TempFolder folder_;
  std::unique_ptr<Store> store_;
  std::shared_ptr<const Lattice> lattice_;
  Mapper mapper_;
  Counts counts_;
};

/// Scans a second and how many times real time that is.
Row rate_row(int threads, double seconds, std::size_t scans, const std::string& data,
             const Counts& counts) {
  Row row{.name = "ingest", .threads = threads, .unit = "scans/s", .data = data};
  row.ours = static_cast<double>(scans) / seconds;
  row.baseline = kRealTimeScansPerS;
  row.ratio = row.ours / kRealTimeScansPerS;
  row.extra["scans"] = scans;
  row.extra["cells"] = counts.cells;
  row.extra["loops"] = counts.loops;
  return row;
}

double peak_rss_mib() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1024;
  }
  return 0;
}

/// So that the peak is that of what comes next (proc(5), clear_refs).
void forget_peak_rss() {
  malloc_trim(0);
  std::ofstream("/proc/self/clear_refs") << 5;
}

/// The peak of a process that does nothing but map the drive from disk into a store.
double peak_rss_of_child_mib(const std::filesystem::path& drive, int threads) {
  const std::string command = std::filesystem::read_symlink("/proc/self/exe").string() +
                              " --peak-memory-of '" + drive.string() + "' --threads " +
                              std::to_string(threads);
  FILE* pipe = popen(command.c_str(), "r");
  double mib = 0;
  const bool read = pipe != nullptr && std::fscanf(pipe, "%lf", &mib) == 1;
  if (pipe == nullptr || pclose(pipe) != 0 || !read) {
    throw Error(ErrorCode::kInternal, "the child process that maps " + drive.string() + " failed");
  }
  return mib;
}

}  // namespace

void ingest_rows(const Setting& setting, const AddRow& add) {
  std::vector<PosedScan> scans = setting.simulated;
  if (setting.quick) {
    scans.resize(kQuickScans);
  } else {
    scans = simulated_scans(0, kFullScans);
  }
  const test::TempFolder folder;
  MemorySource source(scans);
  write_dataset(source, folder / "drive");
  for (const int threads : setting.threads) {
    Counts counts;
    double processor_seconds = 0;
    const Contestant ours{[&] {
                            const double begin = processor_s();
                            counts = map_in_memory(scans, setting.lattice, threads);
                            processor_seconds = processor_s() - begin;
                          },
                          [] {}};
    Effort effort{.seconds = 30, .min_pairs = 2, .max_pairs = 5, .warm_up = false};
    effort.threads = threads;
    if (setting.quick) effort.seconds = 1;
    const Comparison comparison = measure(ours, effort);
    Row row = rate_row(threads, comparison.ours_s, scans.size(), kSimulated, counts);
    row.extra["processor_ms_per_scan"] =
        1e3 * processor_seconds / static_cast<double>(scans.size());
    row.extra["peak_rss_mib"] = peak_rss_of_child_mib(folder / "drive", threads);
    row.extra["pairs"] = comparison.pairs;
    row.extra["kept"] = comparison.kept;
    add(std::move(row));
  }
}

int print_peak_memory_of_build(const std::string& folder, int threads) {
  MapInStore map(threads);
  const auto source = open_dataset(folder);
  map.add(*source);
  map.finish();
  std::cout << peak_rss_mib() << '\n';
  return 0;
}

void kitti00_ingest_row(const AddRow& add) {
  SimulatorOptions options;
  options.route = kitti00_route().string();
  options.threads = 0;
  const auto source = simulate(options);
  const int threads = 2;
  forget_peak_rss();
  MapInStore map(threads);
  const double start = now_s();
  double seconds = 0, processor_seconds = 0;
  std::size_t scans = 0;
  const auto timed = [&](const auto& step) {
    const double begin = now_s(), processor_begin = processor_s();
    step();
    seconds += now_s() - begin;
    processor_seconds += processor_s() - processor_begin;
  };
  for (std::vector<PosedScan> part; !(part = next_scans(*source, kScansAPart)).empty();) {
    MemorySource drive(part);
    timed([&] { map.add(drive); });
    scans += part.size();
    if (scans % 500 != 0) continue;
    std::cerr << scans << " scans, " << map.counts().cells << " CELLs, " << map.counts().loops
              << " loops, " << static_cast<double>(scans) / seconds << " scans/s, "
              << 1e3 * processor_seconds / static_cast<double>(scans)
              << " ms of processor a scan, peak " << peak_rss_mib() << " MiB\n";
  }
  const double source_seconds = now_s() - start - seconds;
  timed([&] { map.finish(); });
  Row row = rate_row(threads, seconds, scans, "simulated drive, KITTI 00 route", map.counts());
  row.extra["processor_ms_per_scan"] = 1e3 * processor_seconds / static_cast<double>(scans);
  row.extra["peak_rss_mib"] = peak_rss_mib();
  row.extra["simulator_scans_per_s"] = static_cast<double>(scans) / source_seconds;
  row.extra["note"] =
      "with encoding and the commits to the store; the peak memory includes the simulator's";
  add(std::move(row));
}

}  // namespace cellmap::bench
