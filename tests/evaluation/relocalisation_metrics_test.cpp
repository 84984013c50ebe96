#include "cellmap/evaluation/relocalisation_metrics.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

namespace cellmap {
namespace {

RelocalisationTrial right(double confidence, double error_m = 0.01) {
  return {.accepted = true, .confidence = confidence, .error_m = error_m, .error_deg = 0.1};
}
RelocalisationTrial wrong(double confidence) {
  return {.accepted = true, .confidence = confidence, .error_m = 50, .error_deg = 90};
}
RelocalisationTrial refused(double error_m) {
  return {.accepted = false, .confidence = 0.2, .error_m = error_m, .error_deg = 0.1};
}

TEST(RelocalisationMetrics, OnlyRightAnswersAboveEveryWrongOneCountAtFullPrecision) {
  const std::vector trials = {right(0.9), right(0.8), wrong(0.7), right(0.6), refused(0.01)};
  const RelocalisationReport report = summarise("s", trials);
  EXPECT_DOUBLE_EQ(report.recall_at_full_precision, 2.0 / 5);
  EXPECT_DOUBLE_EQ(report.recall_at_1, 4.0 / 5);
  EXPECT_EQ(report.wrong_accepted, 1u);
  EXPECT_EQ(report.accepted, 4u);
}

TEST(RelocalisationMetrics, WithoutAWrongAnswerTheRecallIsTheShareFound) {
  const std::vector trials = {right(0.0), right(0.5), refused(7), refused(0.02)};
  const RelocalisationReport report = summarise("s", trials);
  EXPECT_DOUBLE_EQ(report.recall_at_full_precision, 0.5);
  EXPECT_DOUBLE_EQ(report.recall_at_1, 0.75);
}

TEST(RelocalisationMetrics, AWrongAnswerOfAnotherScenarioOfTheMapCountsToo) {
  const std::vector trials = {right(0.9), right(0.5)};
  EXPECT_DOUBLE_EQ(summarise("s", trials, {}, 0.6).recall_at_full_precision, 0.5);
}

TEST(RelocalisationMetrics, EveryAnswerFromAPlaceThatIsNotMappedIsWrong) {
  RelocalisationTrial trial = right(0.9);
  trial.mapped = false;
  const RelocalisationReport report = summarise("elsewhere", std::vector{trial, refused(0)});
  EXPECT_EQ(report.wrong_accepted, 1u);
  EXPECT_DOUBLE_EQ(highest_wrong_confidence(std::vector{trial}), 0.9);
  EXPECT_EQ(report.mapped, 1u);
}

TEST(RelocalisationMetrics, QuantilesAreOfTheRightAnswersOnly) {
  std::vector<RelocalisationTrial> trials = {wrong(0.1), refused(3)};
  for (int i = 1; i <= 100; ++i) trials.push_back(right(0.9, 0.001 * i));
  const RelocalisationReport report = summarise("s", trials);
  EXPECT_NEAR(report.error_m.median, 0.050, 1e-12);
  EXPECT_NEAR(report.error_m.p95, 0.095, 1e-12);
}

TEST(RelocalisationMetrics, BinsCoverEveryMappedQueryOnce) {
  std::vector<RelocalisationTrial> trials;
  for (const double d : {0.0, 0.5, 1.0, 2.99, 3.0, 25.0}) {
    trials.push_back(right(0.9));
    trials.back().distance_m = d;
    trials.back().lateral_m = 3.5;
  }
  const RelocalisationReport report = summarise("s", trials);
  std::size_t queries = 0;
  for (const auto& bin : report.by_distance) queries += bin.queries;
  EXPECT_EQ(queries, trials.size());
  EXPECT_EQ(report.by_distance.front().queries, 2u);
  ASSERT_EQ(report.by_lateral.size(), 1u);
  EXPECT_EQ(report.by_lateral.front().found, trials.size());
}

TEST(RelocalisationMetrics, JsonHasTheAgreedKeysAndNullsForWhatThereIsNot) {
  RelocalisationTrial elsewhere = refused(std::numeric_limits<double>::infinity());
  elsewhere.mapped = false;
  const auto json = nlohmann::json::parse(to_json(summarise("elsewhere", std::vector{elsewhere})));
  EXPECT_TRUE(json.at("recall_at_full_precision").is_null());
  EXPECT_TRUE(json.at("recall_at_1").is_null());
  EXPECT_EQ(json.at("wrong_accepted"), 0);
  for (const char* key : {"error_m", "error_deg"}) {
    EXPECT_TRUE(json.at(key).at("median").is_null());
    EXPECT_TRUE(json.at(key).at("p95").is_null());
  }
  EXPECT_EQ(json.at("query_ms").at("p95"), 0.0);
}

}  // namespace
}  // namespace cellmap
