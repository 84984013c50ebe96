#include "cellmap/codec/coded_cell.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <span>
#include <string>

#include "cellmap/cell/cell_builder.hpp"
#include "cellmap/codec/plane_displacement.hpp"
#include "cellmap/registration/registration.hpp"
#include "cellmap/scan/scan_source.hpp"
#include "codec/raw_buffer.hpp"
#include "codec/samples.hpp"
#include "support/real_data.hpp"

namespace cellmap {
namespace {

constexpr double kBounds[] = {0.005, 0.01, 0.02, 0.03, 0.05};

struct BuiltCell {
  Cell cell;
  PointCloud base_scan;
};

/// CELLs of a real drive at a new one every 6 m.
std::vector<BuiltCell> built_cells(const std::string& name, const std::string& poses,
                                   std::size_t max_cells) {
  DatasetOptions options;
  options.poses = poses;
  const auto drive = open_dataset(test::real_data(name), options);
  const Lattice lattice(LatticeSpec{});
  std::vector<BuiltCell> cells;
  std::optional<LocalMap> local_map;
  const auto finish = [&] {
    Cell cell = build_cell(*local_map, lattice, {});
    cell.session = "real";
    cells.push_back({std::move(cell), local_map->base_scan().points});
  };
  while (const auto next = drive->next()) {
    Scan scan;
    scan.stamp = next->stamp;
    for (std::size_t i = 0; i < next->points.size(); ++i) {
      const float range = next->points[i].norm();
      if (range > 1 && range < 100) scan.points.push_back(next->points[i]);
    }
    if (local_map && local_map->is_complete_for(next->T_odom_sensor, 6)) {
      finish();
      local_map.reset();
      if (cells.size() == max_cells) return cells;
    }
    if (!local_map) {
      local_map.emplace(scan, next->T_odom_sensor, static_cast<std::uint32_t>(next->index));
    } else {
      local_map->add(scan, next->T_odom_sensor);
    }
  }
  return cells;
}

/// Planes of a room with noise: what neighbours predict well.
Cell room_cell(const LatticeSpec& spec, double noise, std::uint32_t seed) {
  std::mt19937 rng(seed);
  std::normal_distribution<double> normal(0, noise);
  Cell cell;
  cell.lattice = spec;
  cell.session = "room";
  const Lattice lattice(spec);
  const Eigen::Vector3d walls[] = {{8, 0, 0}, {-5, 0, 0}, {0, 6, 0}, {0, -4, 0}, {0, 0, -1.8}};
  const std::uint32_t step = std::max(1u, lattice.size() / 50'000);
  for (std::uint32_t i = 0; i < lattice.size(); i += 1 + rng() % step) {
    const Eigen::Vector3d u = lattice.direction(i);
    if (u.z() > 0.3 || rng() % 10 == 0) continue;
    double nearest = 1e9;
    Eigen::Vector3d n(0, 0, 0);
    for (const Eigen::Vector3d& wall : walls) {
      const double range = wall.squaredNorm() / std::max(1e-9, wall.dot(u));
      if (range < nearest) {
        nearest = range;
        n = -wall.normalized();
      }
    }
    n = (n + Eigen::Vector3d(normal(rng), normal(rng), normal(rng))).normalized();
    if (n.dot(u) > -1e-3) continue;
    cell.indices.push_back(i);
    cell.planes.push_back({static_cast<float>(nearest * (1 + normal(rng))),
                           static_cast<float>(n.x()), static_cast<float>(n.y()),
                           static_cast<float>(n.z())});
  }
  return cell;
}

/// Planes that no scheme likes: met at every grazing angle, from a micrometre to 10 km away.
Cell adversarial_cell(std::uint32_t seed, const LatticeSpec& spec) {
  std::mt19937 rng(seed);
  std::uniform_real_distribution<double> uniform(0, 1);
  Cell cell;
  cell.lattice = spec;
  cell.session = "bad";
  const Lattice lattice(spec);
  std::uint32_t next = 0;
  while (next < lattice.size()) {
    const Eigen::Vector3d u = lattice.direction(next);
    const double sine = std::pow(10, -6 * uniform(rng));  // of the angle between ray and plane
    const Eigen::Vector3d side =
        u.cross(Eigen::Vector3d(uniform(rng) - 0.5, uniform(rng) - 0.5, uniform(rng) - 0.5))
            .normalized();
    const Eigen::Vector3f n =
        (-sine * u + std::sqrt(1 - sine * sine) * side).normalized().cast<float>();
    const auto distance = static_cast<float>(std::min(1e4, std::pow(10, 10 * uniform(rng) - 6)));
    if (n.cast<double>().dot(u) < 0) {
      cell.indices.push_back(next);
      cell.planes.push_back({distance, n.x(), n.y(), n.z()});
    }
    next += 1 + static_cast<std::uint32_t>(rng() % (rng() % 8 == 0 ? 400 : 3));
  }
  return cell;
}

/// The farthest of many points of a patch, moved as the definition says: the slow twin.
double sampled_displacement(const Plane& source, const Plane& decoded, const Eigen::Vector3d& u,
                            double radius) {
  const Eigen::Vector3d n(source.nx, source.ny, source.nz), n2(decoded.nx, decoded.ny, decoded.nz);
  const Eigen::Vector3d t1 = u.unitOrthogonal(), t2 = u.cross(t1);
  double worst = 0;
  for (int ring = 0; ring <= 4; ++ring) {
    for (int k = 0; k < 720; ++k) {
      const double angle = radius * ring / 4, phi = k * M_PI / 360;
      const Eigen::Vector3d v =
          std::cos(angle) * u + std::sin(angle) * (std::cos(phi) * t1 + std::sin(phi) * t2);
      const Eigen::Vector3d p = n.dot(u) * source.distance_m / n.dot(v) * v;
      const Eigen::Vector3d q = n2.dot(u) * decoded.distance_m / n2.dot(v) * v;
      worst = std::max(worst, std::abs(n.normalized().dot(q - p)));
    }
  }
  return worst;
}

void expect_same_header(const Cell& a, const Cell& b) {
  EXPECT_EQ(a.lattice, b.lattice);
  EXPECT_EQ(a.session, b.session);
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.T_odom_cell.matrix(), b.T_odom_cell.matrix());
  EXPECT_EQ(a.first_stamp, b.first_stamp);
  EXPECT_EQ(a.last_stamp, b.last_stamp);
  EXPECT_EQ(a.first_scan, b.first_scan);
  EXPECT_EQ(a.scan_count, b.scan_count);
  EXPECT_EQ(a.statistics, b.statistics);
  EXPECT_EQ(a.indices, b.indices);
}

/// Encodes, decodes and holds every plane to the bound; returns bytes a plane.
double expect_bound_holds(const Cell& cell, double bound_m) {
  const EncodedCell encoded = encode_compact_cell(cell, bound_m);
  const DecodedCell decoded = decode_coded_cell(encoded.bytes);
  EXPECT_EQ(decoded.hash, encoded.hash);
  EXPECT_EQ(decoded.raw_hash, encode_cell(cell).hash);
  EXPECT_NEAR(decoded.bound_m, bound_m, 1e-9);
  expect_same_header(decoded.cell, cell);
  EXPECT_LE(cell_displacement(cell, decoded.cell).worst_m, bound_m * (1 + 1e-9));
  return static_cast<double>(encoded.bytes.size()) /
         static_cast<double>(std::max<std::size_t>(1, cell.planes.size()));
}

void expect_packed_returns(const Cell& cell) {
  const EncodedCell raw = encode_cell(cell);
  const EncodedCell packed = encode_packed_cell(cell);
  const DecodedCell decoded = decode_coded_cell(packed.bytes);
  EXPECT_EQ(encode_cell(decoded.cell).bytes, raw.bytes);
  EXPECT_EQ(decoded.raw_hash, raw.hash);
  EXPECT_EQ(decoded.hash, packed.hash);
}

std::vector<Cell> hard_cells() {
  std::vector<Cell> cells = {random_cell(1, 0),   random_cell(2, 1),
                             random_cell(3, 500), random_cell(4, 1000, 1000),
                             room_cell({}, 0, 5), room_cell({}, 0.003, 6)};
  for (const LatticeSpec& spec :
       {LatticeSpec{LatticeKind::kFibonacci, 1000}, LatticeSpec{LatticeKind::kFibonacci, 1'000'000},
        LatticeSpec{LatticeKind::kFibonacciBands, 1000},
        LatticeSpec{LatticeKind::kFibonacciBands, 50'000}}) {
    cells.push_back(room_cell(spec, 0.003, 7));
    cells.push_back(adversarial_cell(8, spec));
  }
  return cells;
}

TEST(CodedCell, PackedComesBackToTheBit) {
  for (const Cell& cell : hard_cells()) expect_packed_returns(cell);
}

TEST(CodedCell, NoPlaneOfACompactCellMovesFartherThanTheBound) {
  for (const Cell& cell : hard_cells()) {
    SCOPED_TRACE(to_string(cell.lattice) + " " + cell.session);
    for (const double bound_m : kBounds) expect_bound_holds(cell, bound_m);
  }
}

TEST(CodedCell, EqualCellsGiveEqualBytes) {
  const Cell cell = room_cell({}, 0.003, 9);
  EXPECT_EQ(encode_compact_cell(cell).bytes, encode_compact_cell(cell).bytes);
  EXPECT_EQ(encode_packed_cell(cell).bytes, encode_packed_cell(cell).bytes);
}

TEST(CodedCell, WallsCostLessThanNoise) {
  const Cell flat = room_cell({}, 0, 5), noisy = room_cell({}, 0.01, 5);
  EXPECT_LT(expect_bound_holds(flat, 0.02), expect_bound_holds(noisy, 0.02));
}

TEST(CodedCell, ABoundOutsideItsRangeIsRefused) {
  for (const double bound : {0.0, -1.0, 0.0009, 1.1, double(NAN)}) {
    const auto thrown = thrown_by([&] { encode_compact_cell(random_cell(1, 3), bound); });
    ASSERT_TRUE(thrown);
    EXPECT_EQ(thrown->code, ErrorCode::kInvalidArgument);
  }
}

TEST(PlaneDisplacement, IsThatOfTheFarthestSample) {
  std::mt19937 rng(3);
  std::normal_distribution<double> normal(0, 1);
  for (int trial = 0; trial < 300; ++trial) {
    const Cell cell = random_cell(static_cast<std::uint32_t>(trial), 1);
    const Lattice lattice(cell.lattice);
    const Eigen::Vector3d u = lattice.direction(cell.indices[0]);
    const Plane source = cell.planes[0];
    const Eigen::Vector3d n = (Eigen::Vector3d(source.nx, source.ny, source.nz) +
                               0.01 * Eigen::Vector3d(normal(rng), normal(rng), normal(rng)))
                                  .normalized();
    const Plane decoded{source.distance_m + static_cast<float>(0.02 * normal(rng)), float(n.x()),
                        float(n.y()), float(n.z())};
    const double radius = lattice.patch_radius_rad();
    const double exact = plane_displacement_m(source, decoded, u, radius);
    const double sampled = sampled_displacement(source, decoded, u, radius);
    EXPECT_GE(exact, sampled * (1 - 1e-9));
    EXPECT_LE(exact, sampled * (1 + 1e-3));
  }
}

TEST(PlaneDisplacement, IsInfiniteWhereTheDecodedPlaneLeavesThePatch) {
  const Eigen::Vector3d u(1, 0, 0);
  const Plane source{10, -1, 0, 0};
  EXPECT_EQ(plane_displacement_m(source, source, u, 0.01), 0);
  EXPECT_TRUE(std::isinf(plane_displacement_m(source, {10, -0.001f, 0.9999995f, 0}, u, 0.01)));
}

/// Every fourth point of a sphere; the lattice of one sphere numbers them so.
bool is_coarse(const Cell& cell, std::uint32_t index) {
  return cell.lattice.kind != LatticeKind::kFibonacci || index % 4 == 0;
}

TEST(CodedCell, ACoarseReadHasEveryFourthPatchOfTheWholeCell) {
  for (const Cell& cell : hard_cells()) {
    SCOPED_TRACE(to_string(cell.lattice) + " " + cell.session);
    for (const EncodedCell& encoded : {encode_packed_cell(cell), encode_compact_cell(cell, 0.02)}) {
      const std::size_t needed = coarse_cell_bytes(encoded.bytes);
      const std::span prefix(encoded.bytes.data(), needed);
      const DecodedCell coarse = decode_coarse_cell(prefix, encoded.bytes.size());
      const Cell all = decode_coded_cell(encoded.bytes).cell;
      validate(coarse.cell);
      EXPECT_TRUE(coarse.is_coarse);
      EXPECT_EQ(coarse.all_planes, cell.planes.size());
      EXPECT_EQ(coarse.raw_hash, encode_cell(cell).hash);
      std::size_t at = 0, expected = 0;
      for (std::size_t k = 0; k < all.indices.size(); ++k) {
        const bool is_there =
            at < coarse.cell.indices.size() && coarse.cell.indices[at] == all.indices[k];
        expected += is_coarse(cell, all.indices[k]);
        if (cell.lattice.kind == LatticeKind::kFibonacci) {
          EXPECT_EQ(is_there, all.indices[k] % 4 == 0);
        }
        if (!is_there) continue;
        EXPECT_EQ(coarse.cell.planes[at++], all.planes[k]);
      }
      EXPECT_EQ(at, coarse.cell.indices.size());
      if (expected >= 400) {
        EXPECT_NEAR(double(at) / double(all.indices.size()), 0.25, 0.1);
      }
    }
  }
}

TEST(CodedCell, ACoarseReadTakesAQuarterOfTheBytesAndNotLess) {
  const EncodedCell encoded = encode_compact_cell(room_cell({}, 0.003, 6), 0.02);
  const std::size_t needed = coarse_cell_bytes(encoded.bytes);
  EXPECT_LT(needed, encoded.bytes.size() * 2 / 5);
  const std::span prefix(encoded.bytes.data(), needed - 1);
  const auto thrown = thrown_by([&] { decode_coarse_cell(prefix, encoded.bytes.size()); });
  ASSERT_TRUE(thrown);
  EXPECT_EQ(thrown->code, ErrorCode::kCorruptData);
}

TEST(CodedCell, EveryTruncationAndEveryFlippedBitIsNoticed) {
  const Cell cell = room_cell({LatticeKind::kFibonacci, 1000}, 0.003, 11);
  for (const EncodedCell& good : {encode_compact_cell(cell, 0.01), encode_packed_cell(cell)}) {
    const std::size_t coarse = coarse_cell_bytes(good.bytes);
    const auto content_hash = static_cast<std::size_t>(
        std::ranges::search(good.bytes, std::as_bytes(std::span(good.hash.bytes))).begin() -
        good.bytes.begin());
    for (std::size_t size = 0; size < good.bytes.size(); ++size) {
      const std::span part(good.bytes.data(), size);
      EXPECT_TRUE(thrown_by([&] { decode_coded_cell(part); })) << size;
      EXPECT_EQ(thrown_by([&] { decode_coarse_cell(part, good.bytes.size()); }).has_value(),
                size < coarse);
    }
    for (std::size_t bit = 0; bit < 8 * good.bytes.size(); ++bit) {
      Bytes bytes = good.bytes;
      bytes[bit / 8] ^= std::byte{1} << bit % 8;
      EXPECT_TRUE(thrown_by([&] { decode_coded_cell(bytes); })) << bit;
      // Of the content hash, which is of all bytes, a part knows nothing.
      if (bit / 8 >= coarse || bit / 8 - content_hash < good.hash.bytes.size()) continue;
      const std::span part(bytes.data(), coarse);
      EXPECT_TRUE(thrown_by([&] { decode_coarse_cell(part, good.bytes.size()); })) << bit;
    }
  }
}

/// A compact CELL of version 1, which no encoder writes any more.
EncodedCell compact_1() {
  const auto path = std::filesystem::path(CELLMAP_SOURCE_DIR) / "tests/conformance/v1";
  std::ifstream file(path / "room-10mm.canonical.ccod", std::ios::binary);
  const std::string text((std::istreambuf_iterator<char>(file)), {});
  const auto* begin = reinterpret_cast<const std::byte*>(text.data());
  return {.hash = {}, .bytes = Bytes(begin, begin + text.size())};
}

/// Overwrites bytes of the file, then mends its hashes, which are no defence.
TEST(CodedCell, HostileBytesAreRefusedOrValid) {
  const Cell cell = room_cell({LatticeKind::kFibonacci, 1000}, 0.003, 11);
  int accepted = 0, refused = 0;
  for (const EncodedCell& good :
       {encode_compact_cell(cell, 0.01), compact_1(), encode_packed_cell(cell),
        encode_packed_cell(random_cell(4, 300, 1000))}) {
    std::mt19937 rng(12);
    for (int trial = 0; trial < 3000; ++trial) {
      Bytes bytes = good.bytes;
      const std::size_t range = trial % 2 ? bytes.size() : std::min<std::size_t>(400, bytes.size());
      for (int n = 1 + static_cast<int>(rng() % 4); n > 0; --n) {
        bytes[rng() % range] = static_cast<std::byte>(rng() % 3 ? rng() : 0xff * (rng() % 2));
      }
      if (rng() % 8 == 0) bytes.resize(rng() % bytes.size());
      for (int mended = 0; mended < 4; ++mended) {
        const auto thrown = thrown_by([&] { validate(decode_coded_cell(bytes).cell); });
        accepted += !thrown;
        if (!thrown) break;
        ++refused;
        EXPECT_TRUE(thrown->code == ErrorCode::kCorruptData ||
                    thrown->code == ErrorCode::kUnsupported || thrown->code == ErrorCode::kTooLarge)
            << thrown->message;
        const auto at = thrown->message.find("its bytes have ");
        if (at == std::string::npos) break;
        const bool is_coarse = thrown->message.find("coarse hash") != std::string::npos;
        const RawBuffer raw(bytes);
        const ContentHash hash = content_hash_from_hex(thrown->message.substr(at + 15, 64));
        std::memcpy(bytes.data() + raw.field(raw.root(), is_coarse ? 2 : 1), hash.bytes.data(), 32);
      }
    }
  }
  EXPECT_GT(accepted, 0);
  EXPECT_GT(refused, 0);
}

double bytes_per_plane(const std::vector<BuiltCell>& cells, double bound_m) {
  std::size_t bytes = 0, planes = 0;
  for (const BuiltCell& built : cells) {
    bytes +=
        (bound_m > 0 ? encode_compact_cell(built.cell, bound_m) : encode_packed_cell(built.cell))
            .bytes.size();
    planes += built.cell.planes.size();
  }
  return static_cast<double>(bytes) / static_cast<double>(planes);
}

void report(const std::string& name, const std::vector<BuiltCell>& cells) {
  std::string line = name + ": bytes a plane, packed " + std::to_string(bytes_per_plane(cells, 0));
  for (const double bound_m : kBounds) {
    line += ", " + std::to_string(static_cast<int>(bound_m * 1000)) + " mm " +
            std::to_string(bytes_per_plane(cells, bound_m));
  }
  std::printf("[ measured ] %s\n", line.c_str());
}

TEST(CodedCell, RealCellsAreSmallAndWithinTheirBound) {
  if (!exists(test::real_data("kitti00-consecutive"))) GTEST_SKIP() << "no real data";
  const auto cells = built_cells("kitti00-consecutive", "", 2);
  ASSERT_FALSE(cells.empty());
  for (const BuiltCell& built : cells) {
    expect_packed_returns(built.cell);
    for (const double bound_m : kBounds) expect_bound_holds(built.cell, bound_m);
  }
  report("kitti00-consecutive", cells);
  EXPECT_LT(bytes_per_plane(cells, 0), 12.5);
  EXPECT_LT(bytes_per_plane(cells, 0.01), 1.9);
  EXPECT_LT(bytes_per_plane(cells, 0.02), 1.45);
}

TEST(CodedCell, RegistrationHardlyNoticesACompactCell) {
  if (!exists(test::real_data("kitti00-dense"))) GTEST_SKIP() << "no real data";
  const auto cells = built_cells("kitti00-dense", "odom_ndt.txt", 99);
  report("kitti00-dense", cells);
  EXPECT_LT(bytes_per_plane(cells, 0), 12.5);
  EXPECT_LT(bytes_per_plane(cells, 0.01), 1.9);
  EXPECT_LT(bytes_per_plane(cells, 0.02), 1.45);
  const auto lattice = std::make_shared<const Lattice>(LatticeSpec{});
  // Closer to the fixed point than usual, so that the CELLs differ and not where the steps end.
  RegistrationOptions options;
  options.convergence_translation_m = 1e-5;
  options.convergence_rotation_rad = 1e-6;
  options.reuse_share = 0;
  options.stages = default_registration_stages();
  options.stages.back().max_iterations = 200;
  const auto pose_of_pair = [&](std::size_t k, const auto& form) {
    const auto target = [&](const Cell& cell) {
      return RegistrationTarget(std::make_shared<const Cell>(form(cell)), lattice);
    };
    const Cell &a = cells[k].cell, &b = cells[k + 1].cell;
    const auto result =
        register_cells(target(a), cells[k].base_scan, target(b), cells[k + 1].base_scan,
                       a.T_odom_cell.inverse() * b.T_odom_cell, options);
    EXPECT_TRUE(result.converged);
    return result.T_target_source;
  };
  std::vector<Pose> raw;
  for (std::size_t k = 0; k + 1 < cells.size(); ++k) {
    raw.push_back(pose_of_pair(k, [](const Cell& cell) { return cell; }));
  }
  const auto expect_shift = [&](const char* name, const auto& form, double max_m, double max_deg) {
    std::vector<double> shifts_m, turns_deg;
    for (std::size_t k = 0; k < raw.size(); ++k) {
      const Tangent change = log(raw[k].inverse() * pose_of_pair(k, form));
      shifts_m.push_back(change.head<3>().norm());
      turns_deg.push_back(change.tail<3>().norm() * 180 / M_PI);
    }
    std::sort(shifts_m.begin(), shifts_m.end());
    std::sort(turns_deg.begin(), turns_deg.end());
    const std::size_t middle = shifts_m.size() / 2;
    std::printf("[ measured ] %s: registration moves by %.2f mm, %.2f mdeg (medians of %zu)\n",
                name, 1e3 * shifts_m[middle], 1e3 * turns_deg[middle], raw.size());
    EXPECT_LT(shifts_m[middle], max_m) << name;
    EXPECT_LT(turns_deg[middle], max_deg) << name;
  };
  const auto compact = [](double bound_m) {
    return [bound_m](const Cell& cell) {
      return decode_coded_cell(encode_compact_cell(cell, bound_m).bytes).cell;
    };
  };
  const auto coarse = [](double bound_m) {
    return [bound_m](const Cell& cell) {
      const Bytes bytes = encode_compact_cell(cell, bound_m).bytes;
      const std::span prefix(bytes.data(), coarse_cell_bytes(bytes));
      return decode_coarse_cell(prefix, bytes.size()).cell;
    };
  };
  expect_shift("bound 10 mm", compact(0.01), 0.0006, 0.004);
  expect_shift("bound 20 mm", compact(0.02), 0.002, 0.007);
  expect_shift("bound 20 mm, coarse layer alone", coarse(0.02), 0.03, 0.05);
}

}  // namespace
}  // namespace cellmap
