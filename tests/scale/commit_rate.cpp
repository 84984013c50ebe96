// How fast one robot's CELLs go into PostgreSQL, and how fast they are read: of invented CELLs
// whose bytes are of a usual size. Usage: commit_rate ADDRESS MAP CELLS [--one-by-one]. Or how fast
// those of several robots do, each with its own server, or all with one: commit_rate ADDRESS MAP
// CELLS --robots COUNT [--one-map] [--one-server]. Prints JSON.

#include <chrono>
#include <iostream>
#include <memory>
#include <random>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "cellmap/core/error.hpp"
#include "cellmap/store/postgres_store.hpp"

namespace {

using namespace cellmap;

constexpr std::size_t kCellBytes = 20'000;

NewCell make_cell(const std::string& map, std::uint32_t id) {
  auto cell = std::make_shared<Cell>();
  cell->session = "drive";
  cell->sequence = id;
  NewCell made;
  made.id = {id};
  made.T_map_cell.translation().x() = 6.0 * id;
  made.encoded.bytes.resize(kCellBytes);
  std::mt19937_64 random(id + std::hash<std::string>()(map));
  for (std::byte& byte : made.encoded.bytes) byte = static_cast<std::byte>(random());
  made.encoded.hash = sha256(made.encoded.bytes);
  made.cell = std::move(cell);
  return made;
}

/// To the CELL before.
Constraint make_constraint(std::uint32_t id) {
  Constraint constraint;
  constraint.from = {id - 1};
  constraint.to = {id};
  constraint.kind = ConstraintKind::kOdometry;
  constraint.origin = ConstraintOrigin::kMapper;
  constraint.T_from_to.translation().x() = 6;
  constraint.information = Matrix6d::Identity();
  return constraint;
}

template <typename Act>
double per_second(std::uint32_t count, const Act& act) {
  const auto begun = std::chrono::steady_clock::now();
  act();
  return count / std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
}

void measure(Store& store, const std::string& map, std::uint32_t count) {
  store.create_map(map, {});
  std::uint32_t id = 0;
  const auto add = [&](MapUpdate& update) {
    update.cells.push_back(make_cell(map, ++id));
    if (id > 1) update.add_constraints.push_back(make_constraint(id));
  };
  MapUpdate first, many, moves;
  add(first);
  store.commit(map, first);
  std::vector<MapUpdate> single(count);
  for (MapUpdate& update : single) add(update);
  for (std::uint32_t i = 0; i < count; ++i) add(many);
  for (std::uint32_t i = 0; i < count; ++i) moves.poses[{i + 1}].setIdentity();

  std::cout << "{\"one_a_commit\": " << per_second(count, [&] {
    for (const MapUpdate& update : single) store.commit(map, update);
  });
  std::cout << ", \"all_in_one\": " << per_second(count, [&] { store.commit(map, many); });
  std::cout << ", \"moved\": " << per_second(count, [&] { store.commit(map, moves); });
  std::cout << ", \"read\": " << per_second(count, [&] {
    for (std::uint32_t i = 1; i <= count; ++i) (void)store.current_cell(map, {i});
  });
  std::cout << "}\n";
  store.delete_map(map);
}

struct Robots {
  std::uint32_t count = 0;
  bool one_map = false, one_server = false;
};

/// Each robot's CELLs are of its own numbers, one a commit; what is timed is the commits of all.
void measure_robots(const std::string& address, const std::string& map, std::uint32_t cells,
                    const Robots& robots) {
  std::vector<std::unique_ptr<Store>> stores;
  std::vector<std::vector<MapUpdate>> updates(robots.count);
  const auto map_of = [&](std::uint32_t robot) {
    return map + std::to_string(robots.one_map ? 0 : robot);
  };
  for (std::uint32_t robot = 0; robot < robots.count; ++robot) {
    if (robot == 0 || !robots.one_server) stores.push_back(open_postgres_store(address));
    if (robot == 0 || !robots.one_map) stores.front()->create_map(map_of(robot), {});
    for (std::uint32_t i = 0; i < cells; ++i) {
      MapUpdate& update = updates[robot].emplace_back();
      update.cells.push_back(make_cell(map_of(robot), 1 + robot * cells + i));
      if (i > 0) update.add_constraints.push_back(make_constraint(1 + robot * cells + i));
    }
  }
  const auto drive = [&](std::uint32_t robot) {
    Store& store = *stores[robots.one_server ? 0 : robot];
    for (const MapUpdate& update : updates[robot]) store.commit(map_of(robot), update);
  };
  std::cout << "{\"commits\": " << per_second(robots.count * cells, [&] {
    std::vector<std::jthread> driving;
    for (std::uint32_t robot = 0; robot < robots.count; ++robot) driving.emplace_back(drive, robot);
  }) << "}\n";
  for (std::uint32_t robot = 0; robot < (robots.one_map ? 1 : robots.count); ++robot) {
    stores.front()->delete_map(map_of(robot));
  }
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc < 4) throw Error(ErrorCode::kInvalidArgument, "expected an address, a map, a count");
    const auto cells = static_cast<std::uint32_t>(std::stoul(argv[3]));
    PostgresStoreOptions options;
    Robots robots;
    for (int i = 4; i < argc; ++i) {
      const std::string_view option(argv[i]);
      options.one_by_one |= option == "--one-by-one";
      robots.one_map |= option == "--one-map";
      robots.one_server |= option == "--one-server";
      if (option == "--robots" && i + 1 < argc) {
        robots.count = static_cast<std::uint32_t>(std::stoul(argv[++i]));
      }
    }
    if (robots.count > 0) {
      measure_robots(argv[1], argv[2], cells, robots);
    } else {
      measure(*open_postgres_store(argv[1], options), argv[2], cells);
    }
    return 0;
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
