#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "cellmap/evaluation/comparison.hpp"

namespace cellmap {
namespace {

using Json = nlohmann::ordered_json;

/// "0.05", as keys of `f_score`.
std::string distance_name(double distance_m) {
  char name[16];
  std::snprintf(name, sizeof(name), "%g", distance_m);
  return name;
}

Json f_scores(const ComparisonRow& row) {
  Json scores = Json::object();
  for (std::size_t k = 0; k < kFScoreDistancesM.size(); ++k) {
    const std::string name = distance_name(kFScoreDistancesM[k]);
    scores[name] = row.measured ? Json(row.reconstruction.f_score[k]) : Json(nullptr);
  }
  return scores;
}

Json row_json(const ComparisonRow& row) {
  const auto measured = [&](const Json& value) { return row.measured ? value : Json(nullptr); };
  Json json = {{"name", row.name}, {"measured", row.measured}};
  if (!row.note.empty()) json["note"] = row.note;
  json["bytes"] = measured(row.bytes);
  json["bytes_per_m"] = row.bytes_per_m;
  json["planes"] = row.planes ? Json(*row.planes) : Json(nullptr);
  json["bytes_per_plane"] =
      row.planes && *row.planes > 0
          ? Json(static_cast<double>(row.bytes) / static_cast<double>(*row.planes))
          : Json(nullptr);
  json["accuracy_m"] = measured(row.reconstruction.accuracy_m);
  json["completeness_m"] = measured(row.reconstruction.completeness_m);
  json["f_score"] = f_scores(row);
  json["registration_error_m"] = measured(row.registration_error_m);
  json["registration_origin_m"] = measured(row.registration_origin_m);
  json["registration_turn_deg"] = measured(row.registration_turn_deg);
  json["registrations"] = measured(row.registrations);
  json["registrations_failed"] = measured(row.failed);
  json["encode_s"] = measured(row.encode_s);
  json["decode_s"] = measured(row.decode_s);
  return json;
}

template <typename... Values>
std::string line(const char* pattern, Values... values) {
  char text[512];
  std::snprintf(text, sizeof(text), pattern, values...);
  return text;
}

std::string row_text(const ComparisonRow& row) {
  if (!row.measured) {
    return line("%-60s %11s", row.name.c_str(),
                std::isnan(row.bytes_per_m) ? "-" : line("%.0f", row.bytes_per_m).c_str()) +
           "  " + row.note + "\n";
  }
  const ReconstructionErrors& errors = row.reconstruction;
  return line(
      "%-60s %11.0f %7s %8.1f %8.1f  %4.2f %4.2f %4.2f %8.1f %7.1f %6.3f %4zu/%zu %8.2f %8.3f\n",
      row.name.c_str(), row.bytes_per_m,
      row.planes && *row.planes > 0
          ? line("%.2f", static_cast<double>(row.bytes) / static_cast<double>(*row.planes)).c_str()
          : "",
      errors.accuracy_m * 1000, errors.completeness_m * 1000, errors.f_score[0], errors.f_score[1],
      errors.f_score[2], row.registration_error_m * 1000, row.registration_origin_m * 1000,
      row.registration_turn_deg, row.failed, row.registrations, row.encode_s, row.decode_s);
}

}  // namespace

std::string to_json(const Comparison& comparison) {
  Json rows = Json::array();
  for (const ComparisonRow& row : comparison.rows) rows.push_back(row_json(row));
  const Json json = {{"dataset", comparison.dataset},
                     {"scans", comparison.scans},
                     {"held_back", comparison.held_back},
                     {"length_m", comparison.length_m},
                     {"rows", std::move(rows)}};
  return json.dump(2, ' ', false, Json::error_handler_t::replace);
}

std::string to_table(const Comparison& comparison) {
  std::string text = line("%zu scans, %zu of them held back, %.1f m driven\n", comparison.scans,
                          comparison.held_back, comparison.length_m) +
                     line("%-60s %11s %7s %8s %8s  %14s %8s %7s %6s %7s %8s %8s\n", "", "bytes",
                          "bytes", "accuracy", "complete", "F-score at", "scan off", "origin",
                          "turned", "failed", "encode", "decode") +
                     line("%-60s %11s %7s %8s %8s  %14s %8s %7s %6s %7s %8s %8s\n", "", "a metre",
                          "a plane", "mm", "mm", "5   10   20 cm", "mm", "mm", "deg", "", "s", "s");
  for (const ComparisonRow& row : comparison.rows) text += row_text(row);
  return text;
}

}  // namespace cellmap
