#include <functional>
#include <limits>

#include "cellmap/core/hash.hpp"
#include "codec/raw_buffer.hpp"
#include "server/server_fixture.hpp"

// CELLs that are well-formed, carry the hash of their bytes, and hold what no CELL may hold.

namespace cellmap::server::test {
namespace {

// Ids of schema/cell.fbs.
constexpr int kHash = 1, kIndices = 3, kPlanes = 4, kPose = 7;

struct Damage {
  const char* name;
  std::function<void(RawBuffer&)> apply;
};

void PrintTo(const Damage& damage, std::ostream* stream) { *stream << damage.name; }

std::size_t index_at(const RawBuffer& raw, std::size_t k) {
  return raw.target(raw.root(), kIndices) + 4 + 4 * k;
}
std::size_t pose_at(const RawBuffer& raw) { return raw.field(raw.root(), kPose); }

const Damage kDamages[] = {
    {"DuplicateIndices",
     [](RawBuffer& raw) {
       const std::size_t plane = raw.target(raw.root(), kPlanes) + 4;
       raw.set(index_at(raw, 1), raw.get<std::uint32_t>(index_at(raw, 0)));
       for (std::size_t byte = 0; byte < 16; byte += 4) {
         raw.set(plane + 16 + byte, raw.get<std::uint32_t>(plane + byte));
       }
     }},
    {"IndexOutsideOfTheLattice",
     [](RawBuffer& raw) { raw.set<std::uint32_t>(index_at(raw, 0), UINT32_MAX); }},
    {"ScaledRotation",
     [](RawBuffer& raw) {
       for (std::size_t k = 0; k < 12; ++k) {
         if (k % 4 == 3) continue;  // the translation
         raw.set(pose_at(raw) + 8 * k, 1.01 * raw.get<double>(pose_at(raw) + 8 * k));
       }
     }},
    {"Reflection",
     [](RawBuffer& raw) {
       for (std::size_t k = 8; k < 11; ++k) {
         raw.set(pose_at(raw) + 8 * k, -raw.get<double>(pose_at(raw) + 8 * k));
       }
     }},
    {"PoseThatIsNotFinite",
     [](RawBuffer& raw) {
       raw.set(pose_at(raw) + 8 * 3, std::numeric_limits<double>::quiet_NaN());
     }},
};

class HostileCells : public ApiTest, public ::testing::WithParamInterface<Damage> {
 protected:
  HostileCells() { make_map(); }

  /// A CELL of the street, damaged, with the hash of the bytes it then has.
  EncodedCell damaged() const {
    EncodedCell cell = street_cell(0, 0);
    RawBuffer raw(cell.bytes);
    GetParam().apply(raw);
    const std::size_t hash = raw.field(raw.root(), kHash);
    std::fill_n(cell.bytes.begin() + static_cast<std::ptrdiff_t>(hash), 32, std::byte{0});
    cell.hash = sha256(cell.bytes);
    std::memcpy(cell.bytes.data() + hash, cell.hash.bytes.data(), 32);
    return cell;
  }

  Response put(const std::string& target, const EncodedCell& cell) {
    return send("PUT", target, to_text(cell.bytes),
                {{"Content-Type", "application/vnd.cellmap.cell"}});
  }
};

TEST_P(HostileCells, AreRefusedWhereverTheyCome) {
  const EncodedCell cell = damaged();
  ASSERT_EQ(verified_hash(cell.bytes), cell.hash) << "the hash is not what refuses it";
  const std::string session = "/v1/maps/town/sessions/drive/cells/" + to_hex(cell.hash);
  expect_problem(put("/v1/maps/town/cells/1", cell), 422, "corrupt-data");
  expect_problem(put(session, cell), 422, "corrupt-data");
  expect_problem(send("POST", "/v1/maps/town/relocalise", to_text(cell.bytes),
                      {{"Content-Type", "application/vnd.cellmap.cell"}}),
                 422, "corrupt-data");
  EXPECT_EQ(json_of(get("/v1/maps/town"))["cells"], 0);
}

INSTANTIATE_TEST_SUITE_P(Sealed, HostileCells, ::testing::ValuesIn(kDamages),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
}  // namespace cellmap::server::test
