#include <benchmark/benchmark.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <fstream>
#include <iostream>
#include <map>

#include "bench/rows.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/pipeline/build_map.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "support/real_data.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::bench {
namespace {

constexpr double kRealTimeScansPerS = 10.0;
constexpr const char* kMap = "bench";
constexpr int kQuickScans = 60;

MapperOptions mapper_options(int threads) {
  MapperOptions options;
  options.build.threads = threads;
  options.registration.threads = threads;
  options.loops.registration.threads = threads;
  options.pose_graph.threads = threads;
  return options;
}

/// A mapper with the CELLs it has made, in memory.
class MapInMemory {
 public:
  MapInMemory(std::shared_ptr<const Lattice> lattice, int threads)
      : lattice_(std::move(lattice)),
        mapper_(mapper_options(threads), "bench", lattice_, {},
                [this](CellId id) { return targets_.at(id); }) {}

  void add(const PosedScan& scan) { keep(mapper_.add(scan)); }
  void finish() { keep(mapper_.finish()); }
  std::size_t cells() const { return targets_.size(); }
  std::size_t loops() const { return loops_; }

 private:
  void keep(const std::optional<CellUpdate>& update) {
    if (!update) return;
    targets_[update->id] = std::make_shared<const RegistrationTarget>(update->cell, lattice_);
    for (const Constraint& c : update->constraints) loops_ += c.kind == ConstraintKind::kLoop;
  }

  std::shared_ptr<const Lattice> lattice_;
  std::map<CellId, std::shared_ptr<const RegistrationTarget>> targets_;
  std::size_t loops_ = 0;
  Mapper mapper_;
};

/// Scans a second and how many times real time that is.
Row rate_row(int threads, double seconds, std::size_t scans, const std::string& data) {
  Row row{.name = "ingest", .threads = threads, .unit = "scans/s", .data = data};
  row.ours = static_cast<double>(scans) / seconds;
  row.baseline = kRealTimeScansPerS;
  row.ratio = row.ours / kRealTimeScansPerS;
  row.extra["scans"] = scans;
  return row;
}

double peak_rss_mib() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);) {
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1024;
  }
  return 0;
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

std::shared_ptr<const Cell> load(const Store& store, CellId id) {
  return std::make_shared<const Cell>(
      decode_cell(zstd_decompress(*store.compressed_cell(kMap, id), kMaxCellBytes)));
}

}  // namespace

void ingest_rows(const Setting& setting, const AddRow& add) {
  // The full run comes back to its first street, so that loops are closed.
  const auto scans = setting.quick ? std::vector<PosedScan>(setting.simulated.begin(),
                                                            setting.simulated.begin() + kQuickScans)
                                   : simulated_scans(0, 600);
  const test::TempFolder folder;
  MemorySource source(scans);
  write_dataset(source, folder / "drive");
  for (const int threads : setting.threads) {
    std::size_t cells = 0, loops = 0;
    const Contestant ours{[&] {
                            MapInMemory map(setting.lattice, threads);
                            for (const PosedScan& scan : scans) map.add(scan);
                            map.finish();
                            cells = map.cells();
                            loops = map.loops();
                          },
                          [] {}};
    const Comparison comparison = measure(
        ours,
        {.seconds = setting.quick ? 1.0 : 60.0, .min_pairs = 2, .max_pairs = 5, .warm_up = false});
    Row row = rate_row(threads, comparison.ours_s, scans.size(), kSimulated);
    row.extra["cells"] = cells;
    row.extra["loops"] = loops;
    row.extra["peak_rss_mib"] = peak_rss_of_child_mib(folder / "drive", threads);
    row.extra["pairs"] = comparison.pairs;
    row.extra["kept"] = comparison.kept;
    add(std::move(row));
  }
}

int print_peak_memory_of_build(const std::string& folder, int threads) {
  const test::TempFolder store_folder;
  const auto store = open_sqlite_store(store_folder / "map.db");
  const auto lattice = std::make_shared<const Lattice>(store->create_map(kMap, {}).lattice);
  Mapper mapper(mapper_options(threads), "bench", lattice, {}, [&](CellId id) {
    return std::make_shared<const RegistrationTarget>(load(*store, id), lattice);
  });
  const auto source = open_dataset(folder);
  build_map(*source, mapper, [&](CellUpdate&& update) {
    MapUpdate change;
    change.cells.push_back({update.id, update.cell, encode_cell(*update.cell),
                            update.poses.at(update.id), update.scans, update.raw_points});
    change.poses = update.poses;
    change.poses.erase(update.id);
    change.add_constraints = update.constraints;
    store->commit(kMap, change);
  });
  std::cout << peak_rss_mib() << '\n';
  return 0;
}

void kitti00_ingest_row(const AddRow& add) {
  const auto route = test::real_data("kitti-trajectories") / "ground_truth" / "00.txt";
  SimulatorOptions options;
  options.route = route.string();
  options.threads = 0;
  const auto source = simulate(options);
  const int threads = 0;
  MapInMemory map(std::make_shared<const Lattice>(LatticeSpec{}), threads);
  double seconds = 0;
  std::size_t scans = 0;
  while (const auto scan = source->next()) {
    const double begin = now_s();
    map.add(*scan);
    seconds += now_s() - begin;
    if (++scans % 500 == 0) {
      std::cerr << scans << " scans, " << map.cells() << " CELLs, " << map.loops() << " loops, "
                << scans / seconds << " scans/s, peak " << peak_rss_mib() << " MiB\n";
    }
  }
  const double begin = now_s();
  map.finish();
  seconds += now_s() - begin;
  Row row = rate_row(2, seconds, scans, "simulated KITTI 00 route");
  row.extra["cells"] = map.cells();
  row.extra["loops"] = map.loops();
  row.extra["peak_rss_mib"] = peak_rss_mib();
  row.extra["note"] = "peak memory includes the simulator and all CELLs, which are kept in memory";
  add(std::move(row));
}

}  // namespace cellmap::bench
