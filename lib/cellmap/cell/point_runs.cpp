#include "cellmap/cell/point_runs.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "cellmap/core/parallel.hpp"
#include "cellmap/simd/runs.hpp"

namespace cellmap {
namespace {

constexpr std::size_t kPointsAPart = 32 * PointRun::kMostPoints;
constexpr std::size_t kPointsARun = 3;  // of dense scans somewhat more

/// The runs of at most kMostPoints points.
void append_block(const PointCloud& cloud, std::size_t begin, std::size_t end,
                  const Lattice& lattice, std::vector<PointRun>& runs) {
  const std::size_t count = end - begin;
  std::array<std::uint32_t, PointRun::kMostPoints> patch;
  std::array<std::uint32_t, PointRun::kMostPoints + simd::kRunsRoom> start;
  lattice.nearest(cloud.x.data() + begin, cloud.y.data() + begin, cloud.z.data() + begin,
                  std::span(patch).first(count));
  const std::size_t found = simd::run_starts(patch.data(), count, start.data());
  start[found] = static_cast<std::uint32_t>(count);
  const std::size_t before = runs.size();
  runs.resize(before + found);
  PointRun* next = runs.data() + before;
  for (std::size_t k = 0; k < found; ++k) {
    const std::uint32_t index = patch[start[k]];
    *next = {static_cast<std::uint32_t>(begin) + start[k], index, start[k + 1] - start[k]};
    next += index != Lattice::kNowhere;
  }
  runs.resize(static_cast<std::size_t>(next - runs.data()));
}

}  // namespace

void append_runs(const PointCloud& cloud, std::size_t begin, std::size_t end,
                 const Lattice& lattice, int threads, RunParts& parts) {
  const std::size_t count = end - begin, first_part = parts.size();
  parts.resize(first_part + (count + kPointsAPart - 1) / kPointsAPart);
  parallel_for(count, kPointsAPart, threads, [&](std::size_t part_begin, std::size_t part_end) {
    std::vector<PointRun>& runs = parts[first_part + part_begin / kPointsAPart];
    runs.reserve((part_end - part_begin) / kPointsARun);
    for (std::size_t i = part_begin; i < part_end; i += PointRun::kMostPoints) {
      append_block(cloud, begin + i, begin + std::min(part_end, i + PointRun::kMostPoints), lattice,
                   runs);
    }
  });
}

BandedRuns sort_by_band(std::span<const std::vector<PointRun>> parts, std::size_t bands,
                        int threads) {
  std::vector<std::uint32_t> next(parts.size() * bands, 0);
  parallel_for(parts.size(), 1, threads, [&](std::size_t part, std::size_t) {
    for (const PointRun& run : parts[part]) ++next[part * bands + run.patch / kPatchesABand];
  });

  BandedRuns banded;
  std::uint32_t position = 0;
  for (std::size_t band = 0; band < bands; ++band) {
    banded.begin.push_back(position);
    for (std::size_t part = 0; part < parts.size(); ++part) {
      position += std::exchange(next[part * bands + band], position);
    }
  }
  banded.begin.push_back(position);
  banded.runs = std::make_unique_for_overwrite<PointRun[]>(position);
  parallel_for(parts.size(), 1, threads, [&](std::size_t part, std::size_t) {
    for (const PointRun& run : parts[part]) {
      banded.runs[next[part * bands + run.patch / kPatchesABand]++] = run;
    }
  });
  return banded;
}

void PatchPoints::swap_points(std::size_t i, std::size_t j) {
  std::swap(x_[i], x_[j]);
  std::swap(y_[i], y_[j]);
  std::swap(z_[i], z_[j]);
}

void PatchPoints::keep(std::size_t count) {
  count_ = count;
  set_origin((*this)[0]);
}

void PatchPoints::set_origin(const Eigen::Vector3d& origin) {
  for (int i = 0; i < 3; ++i) origin_[i] = static_cast<float>(origin[i]);
  for (std::size_t i = count_; i < simd::padded(count_); ++i) {
    x_[i] = origin_[0];
    y_[i] = origin_[1];
    z_[i] = origin_[2];
  }
}

void BandPoints::sort(const PointCloud& cloud, std::span<const PointRun> band) {
  // How long a run is cannot be predicted, and most are shorter than a block: blocks are copied,
  // and what is too much is overwritten by the next run or lies between two patches.
  constexpr std::size_t kBlock = 8;
  constexpr std::size_t kAhead = 24;
  static_assert(kBlock >= simd::kMomentLanes);
  begin_.fill(0);
  for (const PointRun& run : band) begin_[run.patch % kPatchesABand + 1] += run.count;
  for (std::size_t i = 1; i < begin_.size(); ++i) begin_[i] += begin_[i - 1] + kBlock;
  end_ = begin_;
  const std::size_t room = begin_.back();
  if (room_ < room) {
    room_ = room;
    for (auto* coordinate : {&x_, &y_, &z_}) {
      *coordinate = std::make_unique_for_overwrite<float[]>(room);
    }
  }
  const auto copy = [&](std::size_t from, std::size_t to, std::size_t count) {
    std::memcpy(x_.get() + to, cloud.x.data() + from, count * sizeof(float));
    std::memcpy(y_.get() + to, cloud.y.data() + from, count * sizeof(float));
    std::memcpy(z_.get() + to, cloud.z.data() + from, count * sizeof(float));
  };
  for (std::size_t k = 0; k < band.size(); ++k) {
    const PointRun& run = band[k];
    const std::uint32_t ahead = band[std::min(k + kAhead, band.size() - 1)].first;
    __builtin_prefetch(cloud.x.data() + ahead);
    __builtin_prefetch(cloud.y.data() + ahead);
    __builtin_prefetch(cloud.z.data() + ahead);
    std::uint32_t& to = end_[run.patch % kPatchesABand];
    if (run.first + run.count + kBlock <= cloud.size()) {
      for (std::size_t i = 0; i < run.count; i += kBlock) copy(run.first + i, to + i, kBlock);
    } else {
      copy(run.first, to, run.count);
    }
    to += run.count;
  }
}

PatchPoints BandPoints::of(std::size_t i) {
  const std::uint32_t begin = begin_[i];
  return {x_.get() + begin, y_.get() + begin, z_.get() + begin, end_[i] - begin};
}

}  // namespace cellmap
