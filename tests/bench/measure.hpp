#pragma once

#include <functional>

namespace cellmap::bench {

/// How long a comparison may take.
struct Effort {
  double seconds = 1.0;  ///< no further pair begins after this
  int min_pairs = 3;
  int max_pairs = 50;
  bool warm_up = true;  ///< one run of each before the first pair; a run of seconds needs none
  int threads = 1;      ///< that the contestants use
};

/// One side of a comparison. With `prepare` (not timed) every run is prepared anew; without it a
/// short `run` is repeated within one sample until the clock can resolve it.
struct Contestant {
  std::function<void()> run;
  std::function<void()> prepare = {};
};

/// Medians over the pairs that were kept.
struct Comparison {
  double ours_s = 0, baseline_s = 0;
  double ratio = 0;  ///< median of baseline / ours, pair by pair: above 1 ours is faster
  int pairs = 0;     ///< that were run
  /// That were not disturbed. 0: none; the figures are those of the calmest third, less the time
  /// that was spent waiting for a processor where there is one thread to wait.
  int kept = 0;
};

/// Runs both once to warm up, then A B A B ... and compares each run of ours with the run of the
/// baseline right after it, so that a slower clock or a busy neighbour meets both. A pair is left
/// out where its threads waited for a processor during more than 2 % of its time (the kernel counts
/// it: schedstat in /proc). The loop is not Google Benchmark's, because
/// that neither pairs the repetitions of two benchmarks nor leaves out disturbed ones.
Comparison compare(const Contestant& ours, const Contestant& baseline, const Effort& effort);

/// The median of the undisturbed runs of one contestant; `ratio` and `baseline_s` stay 0.
Comparison measure(const Contestant& ours, const Effort& effort);

/// Seconds for which this thread has been ready to run without a processor, or all threads of the
/// process together. Idle workers of a thread pool look for work and wait, too: they must not count
/// where one thread is measured.
double this_thread_waited_s();
double all_threads_waited_s();

/// Wall clock.
double now_s();

/// Processor time that all threads of the process have used together: what can be told on a machine
/// that is busy with other things.
double processor_s();

}  // namespace cellmap::bench
