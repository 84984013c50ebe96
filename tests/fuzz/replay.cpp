// Every fuzz target on its seeds and on changes of them, the same in each run: what the fuzzers of
// the preset `fuzz` look for at length, looked for shortly in every build.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <ostream>
#include <random>
#include <string>
#include <vector>

#define REPLAY(name) extern "C" int fuzz_##name(const std::uint8_t*, std::size_t);
#include "targets.inc"
#undef REPLAY

namespace {

namespace fs = std::filesystem;
using Input = std::vector<std::uint8_t>;

/// Of each target, with its seeds; long inputs get fewer, at least one a seed.
constexpr std::size_t kMostRuns = 3000;
constexpr std::size_t kMostBytes = 4u << 20;

struct Target {
  const char* name;
  int (*run)(const std::uint8_t*, std::size_t);
};

std::ostream& operator<<(std::ostream& out, const Target& target) { return out << target.name; }

constexpr Target kTargets[] = {
#define REPLAY(name) {#name, fuzz_##name},
#include "targets.inc"
#undef REPLAY
};

std::vector<Input> seeds_of(const Target& target) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(fs::path(CELLMAP_FUZZ_SEEDS) / target.name)) {
    files.push_back(entry.path());
  }
  std::ranges::sort(files);
  std::vector<Input> seeds;
  for (const auto& file : files) {
    std::ifstream in(file, std::ios::binary);
    seeds.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
  }
  return seeds;
}

/// Changes inputs in the ways in which files go wrong and attackers begin.
class Mutator {
 public:
  explicit Mutator(const std::vector<Input>& seeds) : seeds_(seeds) {}

  Input next() {
    Input input = any_seed();
    for (std::size_t changes = 1 + below(3); changes > 0; --changes) change(input);
    return input;
  }

 private:
  std::size_t below(std::size_t n) { return n == 0 ? 0 : random_() % n; }
  const Input& any_seed() { return seeds_[below(seeds_.size())]; }

  void change(Input& input) {
    static constexpr std::uint8_t kEdges[] = {0, 1, 0x7f, 0x80, 0xff, '\n', '"', '-'};
    const std::size_t at = below(input.size());
    switch (input.empty() ? 3 : below(6)) {
      case 0:
        input[at] ^= static_cast<std::uint8_t>(1u << below(8));
        return;
      case 1:
        input[at] = kEdges[below(std::size(kEdges))];
        return;
      case 2:
        input.resize(at);
        return;
      case 3: {  // the beginning of one, the end of another
        const Input& other = any_seed();
        input.resize(at);
        const auto tail = static_cast<std::ptrdiff_t>(below(other.size()));
        input.insert(input.end(), other.begin() + tail, other.end());
        return;
      }
      case 4: {  // four bytes of ones or zeros: a length, an offset or a float
        const std::uint8_t value = below(2) == 0 ? 0 : 0xff;
        for (std::size_t i = at; i < std::min(at + 4, input.size()); ++i) input[i] = value;
        return;
      }
      default: {  // a piece twice
        const Input piece(input.begin() + static_cast<std::ptrdiff_t>(at),
                          input.begin() + static_cast<std::ptrdiff_t>(
                                              std::min(at + 1 + below(16), input.size())));
        input.insert(input.begin() + static_cast<std::ptrdiff_t>(at), piece.begin(), piece.end());
      }
    }
  }

  const std::vector<Input>& seeds_;
  std::mt19937_64 random_{1};
};

enum class Outcome { kAccepted, kRefused, kFailed };

/// Runs a target; says where the input is that it failed on.
Outcome run(const Target& target, const Input& input) {
  // Of its own size, so that a sanitizer sees a read beyond its end.
  const std::vector<std::uint8_t> exact(input.begin(), input.end());
  std::string failure;
  try {
    return target.run(exact.data(), exact.size()) == 0 ? Outcome::kAccepted : Outcome::kRefused;
  } catch (const std::exception& exception) {
    failure = exception.what();
  }
  const fs::path file = fs::path(testing::TempDir()) / (std::string("fuzz-") + target.name);
  std::ofstream(file, std::ios::binary)
      .write(reinterpret_cast<const char*>(exact.data()),
             static_cast<std::streamsize>(exact.size()));
  ADD_FAILURE() << failure << "; the input is in " << file;
  return Outcome::kFailed;
}

class FuzzReplay : public testing::TestWithParam<Target> {};

TEST_P(FuzzReplay, RefusesOrReadsItsSeedsAndChangesOfThem) {
  const Target& target = GetParam();
  const auto seeds = seeds_of(target);
  ASSERT_FALSE(seeds.empty());
  std::size_t accepted = 0;
  for (const Input& seed : seeds) {
    const Outcome outcome = run(target, seed);
    ASSERT_NE(outcome, Outcome::kFailed);
    accepted += outcome == Outcome::kAccepted;
  }
  EXPECT_GE(2 * accepted, seeds.size()) << "seeds that are refused lead nowhere";
  Mutator mutator(seeds);
  std::size_t bytes = 0;
  for (std::size_t change = 0; change < kMostRuns && bytes < kMostBytes; ++change) {
    const Input input = mutator.next();
    bytes += input.size();
    ASSERT_NE(run(target, input), Outcome::kFailed) << "change " << change;
  }
}

INSTANTIATE_TEST_SUITE_P(All, FuzzReplay, testing::ValuesIn(kTargets),
                         [](const auto& info) { return std::string(info.param.name); });

}  // namespace
