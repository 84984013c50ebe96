// How fast one robot's CELLs go into PostgreSQL, and how fast they are read: of invented CELLs
// whose bytes are of a usual size. Usage: commit_rate ADDRESS MAP CELLS [--one-by-one]. Prints
// JSON.

#include <chrono>
#include <iostream>
#include <memory>
#include <random>
#include <string>
#include <string_view>

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

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc < 4) throw Error(ErrorCode::kInvalidArgument, "expected an address, a map, a count");
    PostgresStoreOptions options;
    options.one_by_one = argc > 4 && std::string_view(argv[4]) == "--one-by-one";
    const auto store = open_postgres_store(argv[1], options);
    measure(*store, argv[2], static_cast<std::uint32_t>(std::stoul(argv[3])));
    return 0;
  } catch (const std::exception& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
