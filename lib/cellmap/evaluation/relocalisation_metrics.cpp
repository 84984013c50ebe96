#include "cellmap/evaluation/relocalisation_metrics.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <limits>
#include <nlohmann/json.hpp>

namespace cellmap {
namespace {

constexpr double kUndefined = std::numeric_limits<double>::quiet_NaN();
constexpr std::array kDistanceBordersM = {0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 10.0, 1e9};
constexpr std::array kLateralBordersM = {0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 1e9};
constexpr std::array kConfidenceBorders = {0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.995, 1.1};

bool is_right(const RelocalisationTrial& trial, const RelocalisationLimits& limits) {
  return trial.mapped && trial.error_m <= limits.wrong_m && trial.error_deg <= limits.wrong_deg;
}

/// The value that a share `q` of all does not exceed (nearest rank).
double quantile(std::vector<double>& sorted, double q) {
  if (sorted.empty()) return kUndefined;
  const auto rank = static_cast<std::size_t>(std::ceil(q * static_cast<double>(sorted.size())));
  return sorted[std::max<std::size_t>(rank, 1) - 1];
}

MedianAndP95 spread(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {quantile(values, 0.5), quantile(values, 0.95)};
}

double share(std::size_t part, std::size_t whole) {
  return whole == 0 ? kUndefined : static_cast<double>(part) / static_cast<double>(whole);
}

std::vector<RelocalisationReport::Bin> bins(std::span<const RelocalisationTrial> trials,
                                            const RelocalisationLimits& limits,
                                            std::span<const double> borders,
                                            double RelocalisationTrial::*value) {
  std::vector<RelocalisationReport::Bin> bins;
  for (std::size_t i = 0; i + 1 < borders.size(); ++i) {
    RelocalisationReport::Bin bin{borders[i], borders[i + 1]};
    for (const RelocalisationTrial& trial : trials) {
      if (!trial.mapped || !(trial.*value >= bin.from_m && trial.*value < bin.to_m)) continue;
      ++bin.queries;
      bin.found += trial.accepted && is_right(trial, limits);
    }
    if (bin.queries > 0) bins.push_back(bin);
  }
  return bins;
}

std::vector<RelocalisationReport::Reliability> reliability_of(
    std::span<const RelocalisationTrial> trials, const RelocalisationLimits& limits) {
  std::vector<RelocalisationReport::Reliability> bins;
  for (std::size_t i = 0; i + 1 < kConfidenceBorders.size(); ++i) {
    RelocalisationReport::Reliability bin{kConfidenceBorders[i], kConfidenceBorders[i + 1]};
    for (const RelocalisationTrial& trial : trials) {
      if (!(trial.confidence >= bin.from && trial.confidence < bin.to)) continue;
      ++bin.candidates;
      bin.right += is_right(trial, limits);
      bin.confidence_sum += trial.confidence;
    }
    bins.push_back(bin);
  }
  return bins;
}

nlohmann::ordered_json json_of(const std::vector<RelocalisationReport::Reliability>& bins) {
  auto array = nlohmann::ordered_json::array();
  for (const auto& bin : bins) {
    if (bin.candidates == 0) continue;
    const auto count = static_cast<double>(bin.candidates);
    array.push_back({{"from", bin.from},
                     {"candidates", bin.candidates},
                     {"mean_confidence", bin.confidence_sum / count},
                     {"share_right", static_cast<double>(bin.right) / count}});
  }
  return array;
}

/// Over all reports.
std::string reliability_text(std::span<const RelocalisationReport> reports) {
  std::string text =
      "\nHow often the best candidate is right, accepted or not, by its confidence:\n"
      "confidence from  candidates  mean confidence  share right\n";
  for (std::size_t i = 0; i + 1 < kConfidenceBorders.size(); ++i) {
    RelocalisationReport::Reliability sum;
    for (const RelocalisationReport& report : reports) {
      sum.candidates += report.reliability[i].candidates;
      sum.right += report.reliability[i].right;
      sum.confidence_sum += report.reliability[i].confidence_sum;
    }
    if (sum.candidates == 0) continue;
    const auto count = static_cast<double>(sum.candidates);
    std::array<char, 96> line;
    std::snprintf(line.data(), line.size(), "%15.3f %11zu %16.3f %12.3f\n", kConfidenceBorders[i],
                  sum.candidates, sum.confidence_sum / count,
                  static_cast<double>(sum.right) / count);
    text += line.data();
  }
  return text;
}

nlohmann::ordered_json json_of(const MedianAndP95& spread) {
  return {{"median", spread.median}, {"p95", spread.p95}};  // NaN is written as null
}

nlohmann::ordered_json json_of(const std::vector<RelocalisationReport::Bin>& bins) {
  auto array = nlohmann::ordered_json::array();
  for (const auto& bin : bins) {
    array.push_back({{"from_m", bin.from_m},
                     {"to_m", bin.to_m < 1e8 ? nlohmann::ordered_json(bin.to_m) : nullptr},
                     {"queries", bin.queries},
                     {"found", bin.found}});
  }
  return array;
}

std::string bins_text(const std::vector<RelocalisationReport::Bin>& bins) {
  std::string text;
  for (const auto& bin : bins) {
    std::array<char, 64> cell;
    std::snprintf(cell.data(), cell.size(), "  %g m: %zu/%zu", bin.from_m, bin.found, bin.queries);
    text += cell.data();
  }
  return text;
}

}  // namespace

double highest_wrong_confidence(std::span<const RelocalisationTrial> trials,
                                const RelocalisationLimits& limits) {
  double highest = 0;
  for (const RelocalisationTrial& trial : trials) {
    if (trial.accepted && !is_right(trial, limits)) highest = std::max(highest, trial.confidence);
  }
  return highest;
}

RelocalisationReport summarise(std::string scenario, std::span<const RelocalisationTrial> trials,
                               const RelocalisationLimits& limits, double highest_wrong) {
  RelocalisationReport report;
  report.scenario = std::move(scenario);
  report.queries = trials.size();
  const double own_wrong = highest_wrong_confidence(trials, limits);
  std::vector<double> metres, degrees, milliseconds;
  std::size_t above_wrong = 0, first_right = 0;
  for (const RelocalisationTrial& trial : trials) {
    const bool right = is_right(trial, limits);
    milliseconds.push_back(trial.query_ms);
    report.mapped += trial.mapped;
    first_right += right;
    report.accepted += trial.accepted;
    report.wrong_accepted += trial.accepted && !right;
    if (!trial.accepted || !right) continue;
    metres.push_back(trial.error_m);
    degrees.push_back(trial.error_deg);
    const double wrong = std::max(own_wrong, highest_wrong);
    above_wrong += wrong <= 0 || trial.confidence > wrong;
  }
  report.recall_at_full_precision = share(above_wrong, report.mapped);
  report.recall_at_1 = share(first_right, report.mapped);
  report.error_m = spread(std::move(metres));
  report.error_deg = spread(std::move(degrees));
  report.query_ms = spread(std::move(milliseconds));
  report.reliability = reliability_of(trials, limits);
  report.by_distance = bins(trials, limits, kDistanceBordersM, &RelocalisationTrial::distance_m);
  report.by_lateral = bins(trials, limits, kLateralBordersM, &RelocalisationTrial::lateral_m);
  return report;
}

std::string to_json(const RelocalisationReport& report) {
  const nlohmann::ordered_json json = {
      {"queries", report.queries},
      {"mapped", report.mapped},
      {"accepted", report.accepted},
      {"recall_at_full_precision", report.recall_at_full_precision},
      {"recall_at_1", report.recall_at_1},
      {"wrong_accepted", report.wrong_accepted},
      {"error_m", json_of(report.error_m)},
      {"error_deg", json_of(report.error_deg)},
      {"query_ms", json_of(report.query_ms)},
      {"by_distance", json_of(report.by_distance)},
      {"by_lateral", json_of(report.by_lateral)},
      {"reliability", json_of(report.reliability)},
  };
  return json.dump();
}

std::string to_table(std::span<const RelocalisationReport> reports) {
  std::array<char, 256> line;
  std::string text =
      "                                  recall at    recall  wrong       error m      error deg   "
      "  "
      "time ms\n"
      "scenario                  queries full prec.     at 1  accepted  med    p95    med    p95   "
      " med "
      " "
      "p95\n";
  const auto percent = [](double share) {
    std::array<char, 16> cell;
    std::snprintf(cell.data(), cell.size(), "%.1f %%", 100 * share);
    return std::string(std::isnan(share) ? "-" : cell.data());
  };
  const auto number = [](double value, int decimals) {
    std::array<char, 32> cell;
    std::snprintf(cell.data(), cell.size(), "%.*f", decimals, value);
    return std::string(std::isnan(value) ? "-" : cell.data());
  };
  for (const RelocalisationReport& r : reports) {
    std::snprintf(line.data(), line.size(), "%-25s %7zu %10s %8s %9zu %6s %6s %6s %6s %6s %5s\n",
                  r.scenario.c_str(), r.queries, percent(r.recall_at_full_precision).c_str(),
                  percent(r.recall_at_1).c_str(), r.wrong_accepted,
                  number(r.error_m.median, 3).c_str(), number(r.error_m.p95, 3).c_str(),
                  number(r.error_deg.median, 2).c_str(), number(r.error_deg.p95, 2).c_str(),
                  number(r.query_ms.median, 1).c_str(), number(r.query_ms.p95, 1).c_str());
    text += line.data();
  }
  text += "\nFound, from this distance to the nearest CELL on, and from this lateral offset on:\n";
  for (const RelocalisationReport& r : reports) {
    if (r.mapped == 0) continue;
    text += r.scenario + "\n  distance" + bins_text(r.by_distance) + "\n  lateral " +
            bins_text(r.by_lateral) + "\n";
  }
  text += reliability_text(reports);
  return text;
}

}  // namespace cellmap
