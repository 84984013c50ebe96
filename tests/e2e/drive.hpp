#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "e2e/process.hpp"
#include "support/temp_folder.hpp"

namespace cellmap::test {

/// Runs `cellmap ARGUMENTS`.
inline Ended cellmap_program(const TempFolder& work, std::vector<std::string> arguments) {
  arguments.insert(arguments.begin(), CELLMAP_PROGRAM);
  return Process(std::move(arguments), work / "cellmap.log").wait();
}

/// Runs `cellmap ARGUMENTS --json`, expects success and returns what it printed.
inline nlohmann::json cellmap_json(const TempFolder& work, std::vector<std::string> arguments) {
  arguments.push_back("--json");
  const Ended ended = cellmap_program(work, arguments);
  EXPECT_EQ(ended.exit_code, 0) << arguments.front() << ": " << ended.out;
  return nlohmann::json::parse(ended.out, nullptr, false);
}

/// The scans of a small drive: a LiDAR with few columns keeps the whole test short.
inline std::vector<std::string> simulate_arguments(const std::string& out, int scans) {
  return {"simulate",  "--route", "town",  "--scans", std::to_string(scans),
          "--columns", "500",     "--out", out};
}

}  // namespace cellmap::test
