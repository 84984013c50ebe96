#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "bench/measure.hpp"

namespace cellmap::bench {

/// One line of the table. `ratio` says how many times better ours is than the baseline, whatever
/// the unit.
struct Row {
  std::string name;
  int threads = 1;
  std::string unit;
  double ours = 0, baseline = 0, ratio = 0;
  std::string data;
  nlohmann::json extra = nlohmann::json::object();  ///< further keys: paper_ms, isa, note, ...
};

/// A row of durations. `per_unit_s` is how many seconds one unit is (1e-3 for "ms").
Row duration_row(const std::string& name, int threads, const std::string& unit, double per_unit_s,
                 const Comparison& comparison, const std::string& data);

/// "AMD EPYC, 2 processors, 23 GiB, Linux 6.1; GCC 12.2, Release".
std::string machine();

nlohmann::json to_json(const std::vector<Row>& rows);
std::string to_markdown(const std::vector<Row>& rows);

}  // namespace cellmap::bench
