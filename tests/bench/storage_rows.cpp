#include <benchmark/benchmark.h>
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <stdexcept>
#include <thread>

#include "bench/naive_codec.hpp"
#include "bench/rows.hpp"
#include "cellmap/codec/cell_codec.hpp"
#include "cellmap/codec/coded_cell.hpp"
#include "cellmap/codec/zstd.hpp"
#include "cellmap/simulation/random.hpp"
#include "cellmap/store/sqlite_store.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::bench {
namespace {

constexpr const char* kStoredMap = "bench";

/// The same geometry under another name, and bytes that no other CELL has.
Cell cell_number(const Cell& model, std::uint32_t number) {
  Cell cell = model;
  cell.sequence = number;
  simulation::Random random(number);
  for (Plane& plane : cell.planes)
    plane.distance_m *= static_cast<float>(random.uniform(1.0, 1.01));
  return cell;
}

std::vector<NewCell> new_cells(const Cell& model, std::uint32_t first, std::size_t count) {
  std::vector<NewCell> cells;
  for (std::uint32_t i = 0; i < count; ++i) {
    NewCell made;
    made.id = {first + i};
    made.cell = std::make_shared<const Cell>(cell_number(model, first + i));
    made.encoded = encode_cell(*made.cell);
    made.T_map_cell.translation().x() = 6.0 * (first + i);
    cells.push_back(std::move(made));
  }
  return cells;
}

/// Calls `body(i)` for all i < count on `threads` threads.
template <typename Body>
void on_threads(int threads, std::size_t count, const Body& body) {
  std::atomic<std::size_t> next = 0;
  const auto work = [&] {
    for (std::size_t i = next++; i < count; i = next++) body(i);
  };
  std::vector<std::jthread> others;
  for (int t = 1; t < threads; ++t) others.emplace_back(work);
  work();
}

/// The simplest durable store: one file a CELL, file and folder flushed.
class FileStore {
 public:
  explicit FileStore(std::filesystem::path folder)
      : folder_(std::move(folder)), folder_fd_(open(folder_.c_str(), O_RDONLY | O_DIRECTORY)) {}
  ~FileStore() { close(folder_fd_); }
  FileStore(const FileStore&) = delete;
  FileStore& operator=(const FileStore&) = delete;

  void put(CellId id, const Bytes& bytes) const {
    const int fd = open(path(id).c_str(), O_CREAT | O_WRONLY | O_TRUNC, 0644);
    const bool written =
        fd >= 0 && write(fd, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size());
    if (!written || fsync(fd) != 0 || close(fd) != 0 || fsync(folder_fd_) != 0) {
      throw std::runtime_error("cannot write " + path(id).string());
    }
  }

  Bytes get(CellId id) const {
    Bytes bytes(std::filesystem::file_size(path(id)));
    const int fd = open(path(id).c_str(), O_RDONLY);
    const bool read_all =
        fd >= 0 && read(fd, bytes.data(), bytes.size()) == static_cast<ssize_t>(bytes.size());
    if (!read_all || close(fd) != 0) throw std::runtime_error("cannot read " + path(id).string());
    return bytes;
  }

 private:
  std::filesystem::path path(CellId id) const {
    return folder_ / (std::to_string(id.value) + ".cell");
  }
  std::filesystem::path folder_;
  int folder_fd_;
};

void put_row(const Setting& setting, const Cell& model, int threads, const AddRow& add) {
  const test::TempFolder folder;
  const auto store = open_sqlite_store(folder / "map.db");
  store->create_map(kStoredMap, model.lattice);
  const FileStore files(folder.path());
  const std::size_t count = setting.quick ? 16 : 64;
  std::uint32_t next = 1;
  std::vector<NewCell> cells;
  const Contestant ours{[&] {
                          on_threads(threads, count, [&](std::size_t i) {
                            MapUpdate update;
                            update.cells.push_back(cells[i]);
                            store->commit(kStoredMap, update);
                          });
                        },
                        [&] {
                          cells = new_cells(model, next, count);
                          next += static_cast<std::uint32_t>(count);
                        }};
  const Contestant baseline{[&] {
                              on_threads(threads, count, [&](std::size_t i) {
                                files.put(cells[i].id, cells[i].encoded.bytes);
                              });
                            },
                            [] {}};
  Row row = duration_row("store_put", threads, "ms/CELL", 1e-3 * static_cast<double>(count),
                         compare(ours, baseline, setting.effort(5, threads)), kSimulated);
  row.extra["encoded_bytes"] = cells.front().encoded.bytes.size();
  add(std::move(row));
}

struct StoredCells {
  const test::TempFolder folder;
  std::size_t count;
  FileStore files;

  StoredCells(const Cell& model, std::size_t cells) : count(cells), files(folder.path()) {
    const auto store = open_sqlite_store(folder / "map.db");
    store->create_map(kStoredMap, model.lattice);
    MapUpdate update;
    update.cells = new_cells(model, 1, count);
    store->commit(kStoredMap, update);
    for (const NewCell& cell : update.cells) files.put(cell.id, cell.encoded.bytes);
  }

  CellId random_id(std::size_t i) const {
    return {static_cast<std::uint32_t>(1 + simulation::mix(i) % count)};
  }
};

void get_row(const Setting& setting, const StoredCells& stored, int threads,
             std::size_t cache_bytes, const std::string& data, const AddRow& add) {
  const auto store = open_sqlite_store(stored.folder / "map.db", {.cache_bytes = cache_bytes});
  constexpr std::size_t kReads = 400;
  const Contestant ours{[&] {
    on_threads(threads, kReads, [&](std::size_t i) {
      benchmark::DoNotOptimize(store->compressed_cell(kStoredMap, stored.random_id(i)));
    });
  }};
  const Contestant baseline{[&] {
    on_threads(threads, kReads, [&](std::size_t i) {
      benchmark::DoNotOptimize(stored.files.get(stored.random_id(i)));
    });
  }};
  add(duration_row("store_get", threads, "us/CELL", 1e-6 * kReads,
                   compare(ours, baseline, setting.effort(2, threads)), data));
}

void check_codecs(const Cell& cell, const Bytes& frame, const std::string& naive_frame) {
  const Cell ours = decode_cell(zstd_decompress(frame, kMaxCellBytes));
  const Cell naive = naive_decode(naive_decompress(naive_frame));
  const auto equal = [&](const Cell& decoded) {
    return decoded.indices == cell.indices && decoded.planes == cell.planes &&
           decoded.T_odom_cell.matrix() == cell.T_odom_cell.matrix();
  };
  require_agreement(equal(ours) && equal(naive), "the same CELL after decoding");
}

/// Median processor time of one call: what can be told on a machine that is busy.
template <typename Body>
double processor_us(const Body& body) {
  std::array<double, 101> taken;
  for (double& us : taken) {
    const double before = processor_s();
    body();
    us = 1e6 * (processor_s() - before);
  }
  std::nth_element(taken.begin(), taken.begin() + taken.size() / 2, taken.end());
  return taken[taken.size() / 2];
}

/// A CELL of real keyframes with about the 5,800 planes that a strict test of patches leaves, in
/// every form that it is sent in, beside the naive decoder of all its bytes.
void coded_cell_rows(const Setting& setting, const AddRow& add) {
  const auto cell = strict_kitti_cell(*setting.lattice);
  if (!cell) return;
  const Bytes raw = encode_cell(*cell).bytes, packed = encode_packed_cell(*cell).bytes,
              compact = encode_compact_cell(*cell, kDefaultCompactBoundM).bytes;
  const std::string naive = naive_encode(*cell);
  require_agreement(decode_coded_cell(packed).cell.planes == cell->planes,
                    "the same CELL after decoding");
  const auto add_row = [&](const std::string& form, const Bytes& bytes, const auto& ours) {
    Row row =
        duration_row("cell_decode", 1, "us", 1e-6,
                     compare(Contestant{[&] { benchmark::DoNotOptimize(ours(bytes)); }},
                             Contestant{[&] { benchmark::DoNotOptimize(naive_decode(naive)); }},
                             setting.effort(1, 1)),
                     kKittiDense + (", " + form));
    row.extra["planes"] = cell->planes.size();
    row.extra["encoded_bytes"] = bytes.size();
    row.extra["processor_us"] = processor_us([&] { benchmark::DoNotOptimize(ours(bytes)); });
    add(std::move(row));
  };
  add_row("raw", raw, [](const Bytes& bytes) { return decode_cell(bytes); });
  add_row("packed", packed, [](const Bytes& bytes) { return decode_coded_cell(bytes); });
  add_row("compact, 20 mm", compact, [](const Bytes& bytes) { return decode_coded_cell(bytes); });
  CellDecoder decoder;
  add_row("compact, 20 mm, one of many", compact,
          [&](const Bytes& bytes) { return decoder.decode(bytes); });
}

}  // namespace

void codec_rows(const Setting& setting, const AddRow& add) {
  coded_cell_rows(setting, add);
  for (const CellPair& pair : setting.pairs) {
    const Cell& cell = pair.a.cell();
    const Bytes raw = encode_cell(cell).bytes;
    const Bytes frame = zstd_compress(raw);
    const std::string naive_raw = naive_encode(cell);
    const std::string naive_frame = naive_compress(naive_raw);
    check_codecs(cell, frame, naive_frame);
    const auto add_row = [&](const std::string& name, const std::string& form, const auto& ours,
                             const auto& baseline) {
      Row row = duration_row(
          name, 1, "us", 1e-6,
          compare(Contestant{[&] { benchmark::DoNotOptimize(ours()); }},
                  Contestant{[&] { benchmark::DoNotOptimize(baseline()); }}, setting.effort(1, 1)),
          pair.data + ", " + form);
      row.extra["planes"] = cell.planes.size();
      add(std::move(row));
    };
    add_row(
        "cell_encode", "zstd frame", [&] { return zstd_compress(encode_cell(cell).bytes); },
        [&] { return naive_compress(naive_encode(cell)); });
    add_row(
        "cell_encode", "raw", [&] { return encode_cell(cell); },
        [&] { return naive_encode(cell); });
    add_row(
        "cell_decode", "zstd frame",
        [&] { return decode_cell(zstd_decompress(frame, kMaxCellBytes)); },
        [&] { return naive_decode(naive_decompress(naive_frame)); });
    add_row(
        "cell_decode", "raw", [&] { return view_cell(raw); },
        [&] { return naive_decode(naive_raw); });
  }
}

void store_rows(const Setting& setting, const AddRow& add) {
  const Cell& model = setting.pairs.front().a.cell();
  for (const int threads : setting.threads) put_row(setting, model, threads, add);
  const StoredCells stored(model, setting.quick ? 60 : 300);
  for (const int threads : setting.threads) {
    get_row(setting, stored, threads, 0, std::string(kSimulated) + ", warm disk cache", add);
  }
  for (const int threads : setting.threads) {
    get_row(setting, stored, threads, 64u << 20, std::string(kSimulated) + ", hot CELLs", add);
  }
}

}  // namespace cellmap::bench
