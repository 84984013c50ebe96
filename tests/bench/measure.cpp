#include "bench/measure.hpp"

#include <time.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <vector>

namespace cellmap::bench {
namespace {

constexpr double kMostWaiting = 0.02;  // of the wall time of an undisturbed run
constexpr double kWakeUpS = 20e-6;     // what waking threads costs on an idle machine
/// Long against the clock, short against the slices in which a busy machine hands out processors.
constexpr double kShortestSampleS = 0.003;

double waited_s(const std::filesystem::path& task) {
  double ran_ns = 0, waited_ns = 0;
  std::ifstream(task / "schedstat") >> ran_ns >> waited_ns;
  return 1e-9 * waited_ns;
}

struct Sample {
  double seconds = 0;  // of one run
  double waiting = 0;  // share of the time that was spent waiting for a processor

  double running_s() const { return seconds * (1 - std::min(waiting, 0.99)); }
};

class Sampler {
 public:
  /// The warm-up also tells how often a sample repeats the run.
  Sampler(const Contestant& contestant, const Effort& effort)
      : contestant_(contestant),
        waited_s_(effort.threads == 1 ? this_thread_waited_s : all_threads_waited_s) {
    if (!effort.warm_up) return;
    const double once = take().seconds;
    if (!contestant_.prepare) {
      runs_ = static_cast<int>(std::clamp(std::ceil(kShortestSampleS / once), 1.0, 10'000.0));
    }
  }

  Sample take() const {
    if (contestant_.prepare) contestant_.prepare();
    const double waited_before = waited_s_();
    const double begin = now_s();
    for (int run = 0; run < runs_; ++run) contestant_.run();
    const double wall = std::max(now_s() - begin, 1e-9);
    const double waited = std::max(0.0, waited_s_() - waited_before - kWakeUpS);
    return {wall / runs_, waited / wall};
  }

 private:
  const Contestant& contestant_;
  double (*waited_s_)();
  int runs_ = 1;
};

struct Pair {
  Sample ours, baseline;

  double waiting() const { return std::max(ours.waiting, baseline.waiting); }
  bool is_calm() const { return waiting() <= kMostWaiting; }
};

template <typename Value>
double median(const std::vector<Pair>& pairs, const Value& value) {
  std::vector<double> values;
  for (const Pair& pair : pairs) values.push_back(value(pair));
  std::sort(values.begin(), values.end());
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

Comparison summary(std::vector<Pair> pairs, int threads) {
  std::sort(pairs.begin(), pairs.end(),
            [](const Pair& a, const Pair& b) { return a.waiting() < b.waiting(); });
  Comparison result;
  result.pairs = static_cast<int>(pairs.size());
  result.kept = static_cast<int>(
      std::count_if(pairs.begin(), pairs.end(), [](const Pair& pair) { return pair.is_calm(); }));
  pairs.resize(result.kept > 0 ? static_cast<std::size_t>(result.kept) : (pairs.size() + 2) / 3);
  const bool corrected = result.kept == 0 && threads == 1;
  const auto seconds = [&](const Sample& s) { return corrected ? s.running_s() : s.seconds; };
  result.ours_s = median(pairs, [&](const Pair& p) { return seconds(p.ours); });
  result.baseline_s = median(pairs, [&](const Pair& p) { return seconds(p.baseline); });
  result.ratio =
      median(pairs, [&](const Pair& p) { return seconds(p.baseline) / seconds(p.ours); });
  return result;
}

template <typename TakePair>
Comparison repeat(const Effort& effort, const TakePair& take_pair) {
  std::vector<Pair> pairs;
  const double begin = now_s();
  for (int i = 0; i < effort.max_pairs; ++i) {
    if (i >= effort.min_pairs && now_s() - begin > effort.seconds) break;
    pairs.push_back(take_pair());
  }
  return summary(std::move(pairs), effort.threads);
}

}  // namespace

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double processor_s() {
  timespec used{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &used);
  return static_cast<double>(used.tv_sec) + 1e-9 * static_cast<double>(used.tv_nsec);
}

double this_thread_waited_s() { return waited_s("/proc/thread-self"); }

double all_threads_waited_s() {
  double seconds = 0;
  for (const auto& task : std::filesystem::directory_iterator("/proc/self/task")) {
    seconds += waited_s(task.path());
  }
  return seconds;
}

Comparison compare(const Contestant& ours, const Contestant& baseline, const Effort& effort) {
  const Sampler our_sampler(ours, effort), baseline_sampler(baseline, effort);
  return repeat(effort, [&] {
    const Sample a = our_sampler.take();
    return Pair{a, baseline_sampler.take()};
  });
}

Comparison measure(const Contestant& ours, const Effort& effort) {
  const Sampler sampler(ours, effort);
  return repeat(effort, [&] { return Pair{sampler.take(), {}}; });
}

}  // namespace cellmap::bench
