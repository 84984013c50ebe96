#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "cellmap/evaluation/comparison.hpp"

namespace cellmap {
namespace {

constexpr char kHead[] = R"(<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Map representations compared</title>
<style>
:root { color-scheme: light dark; --paper: #ffffff; --ink: #1b1f24; --faint: #d5d9de; --soft: #5b6570;
  --cells: #0b62c4; --other: #b3541e; }
@media (prefers-color-scheme: dark) {
  :root { --paper: #14171b; --ink: #e8eaed; --faint: #343a41; --soft: #9aa4af; --cells: #6fb1ff;
    --other: #f0a06b; } }
body { background: var(--paper); color: var(--ink); font: 15px/1.5 system-ui, sans-serif;
  max-width: 76rem; margin: 2rem auto; padding: 0 1rem; }
figure { margin: 1.5rem 0; } figcaption { color: var(--soft); }
svg { width: 100%; height: auto; } svg text { fill: var(--ink); font-size: 12px; }
.grid { stroke: var(--faint); } .mark { stroke: var(--paper); } .mark.cells { fill: var(--cells); }
.mark.other { fill: var(--other); } svg text.number { fill: var(--paper); font-size: 10px;
  font-weight: 600; text-anchor: middle; dominant-baseline: central; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; white-space: nowrap; }
th, td { text-align: right; padding: .2rem .6rem; border-bottom: 1px solid var(--faint); }
th:nth-child(2), td:nth-child(2) { text-align: left; } td.note { text-align: left;
  color: var(--soft); } tr.cells td:nth-child(2) { color: var(--cells); }
</style>
</head>
<body>
<h1>Map representations compared</h1>
)";

constexpr double kWidth = 900, kHeight = 460, kLeft = 70, kRight = 20, kTop = 20, kBottom = 50;
constexpr double kMarkRadius = 9;

std::string escaped(const std::string& text) {
  std::string result;
  for (const char c : text) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      default:
        result += c;
    }
  }
  return result;
}

template <typename... Values>
std::string text_of(const char* pattern, Values... values) {
  char text[768];
  std::snprintf(text, sizeof(text), pattern, values...);
  return text;
}

bool is_cells(const ComparisonRow& row) { return row.name.starts_with("CELLs"); }
const char* family(const ComparisonRow& row) { return is_cells(row) ? "cells" : "other"; }

/// One axis: from values to where they are drawn.
struct Axis {
  double low = 0, high = 1;
  bool logarithmic = false;
  double from_px = 0, to_px = 1;

  double place(double value) const {
    const auto scale = [&](double v) { return logarithmic ? std::log10(v) : v; };
    return from_px + (to_px - from_px) * (scale(value) - scale(low)) / (scale(high) - scale(low));
  }
  /// 1, 2 and 5 times powers of ten, or fifths.
  std::vector<double> ticks() const {
    std::vector<double> result;
    if (!logarithmic) {
      for (int k = 0; k <= 5; ++k) result.push_back(low + (high - low) * k / 5);
      return result;
    }
    for (double decade = std::pow(10, std::floor(std::log10(low))); decade <= high; decade *= 10) {
      for (const double step : {1.0, 2.0, 5.0}) {
        const double value = decade * step;
        if (value >= low * 0.999 && value <= high * 1.001) result.push_back(value);
      }
    }
    return result;
  }
};

/// What is plotted over bytes a metre.
struct Plot {
  std::string title, y_name;
  std::function<double(const ComparisonRow&)> value;
  bool logarithmic;
};

bool is_drawn(const ComparisonRow& row, const Plot& plot) {
  if (!row.measured || !(row.bytes_per_m > 0)) return false;
  const double value = plot.value(row);
  return std::isfinite(value) && (!plot.logarithmic || value > 0);
}

Axis axis_over(const std::vector<double>& values, bool logarithmic, double from_px, double to_px) {
  Axis axis{0, 1, logarithmic, from_px, to_px};
  if (values.empty()) return {logarithmic ? 1.0 : 0.0, 10, logarithmic, from_px, to_px};
  if (logarithmic) {
    axis.low = *std::min_element(values.begin(), values.end()) / 1.3;
    axis.high = *std::max_element(values.begin(), values.end()) * 1.3;
  }
  return axis;
}

std::string grid(const Axis& x, const Axis& y, const Plot& plot) {
  std::string svg;
  for (const double value : x.ticks()) {
    const double at = x.place(value);
    svg += text_of("<line class=\"grid\" x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\"/>", at,
                   kTop, at, kHeight - kBottom);
    svg += text_of("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\">%g</text>\n", at,
                   kHeight - kBottom + 18, value);
  }
  for (const double value : y.ticks()) {
    const double at = y.place(value);
    svg += text_of("<line class=\"grid\" x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\"/>", kLeft,
                   at, kWidth - kRight, at);
    svg += text_of("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"end\">%g</text>\n", kLeft - 8, at + 4,
                   value);
  }
  svg += text_of("<text x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\">bytes a metre driven</text>\n",
                 (kLeft + kWidth - kRight) / 2, kHeight - 8);
  svg += text_of(
      "<text transform=\"rotate(-90)\" x=\"%.1f\" y=\"14\" text-anchor=\"middle\">%s"
      "</text>\n",
      -(kTop + kHeight - kBottom) / 2, plot.y_name.c_str());
  return svg;
}

std::string svg_of(const Comparison& comparison, const Plot& plot) {
  std::vector<double> sizes, values;
  for (const ComparisonRow& row : comparison.rows) {
    if (!is_drawn(row, plot)) continue;
    sizes.push_back(row.bytes_per_m);
    values.push_back(plot.value(row));
  }
  const Axis x = axis_over(sizes, true, kLeft, kWidth - kRight);
  const Axis y = axis_over(values, plot.logarithmic, kHeight - kBottom, kTop);
  std::string svg = text_of("<svg viewBox=\"0 0 %g %g\" role=\"img\" aria-label=\"%s\">\n", kWidth,
                            kHeight, plot.title.c_str()) +
                    grid(x, y, plot);
  for (std::size_t k = 0; k < comparison.rows.size(); ++k) {
    const ComparisonRow& row = comparison.rows[k];
    if (!is_drawn(row, plot)) continue;
    const double cx = x.place(row.bytes_per_m), cy = y.place(plot.value(row));
    svg += "<g><title>" + escaped(row.name) + "</title>" +
           text_of("<circle class=\"mark %s\" cx=\"%.1f\" cy=\"%.1f\" r=\"%g\"/>", family(row), cx,
                   cy, kMarkRadius) +
           text_of("<text class=\"number\" x=\"%.1f\" y=\"%.1f\">%zu</text></g>\n", cx, cy, k + 1);
  }
  return svg + "</svg>\n";
}

std::string figure(const Comparison& comparison, const Plot& plot) {
  return "<figure>\n<figcaption>" + plot.title + "</figcaption>\n" + svg_of(comparison, plot) +
         "</figure>\n";
}

std::string cell(const char* pattern, double value) {
  return "<td>" + (std::isfinite(value) ? text_of(pattern, value) : std::string("–")) + "</td>";
}

std::string table_row(const ComparisonRow& row, std::size_t number) {
  std::string html = text_of("<tr class=\"%s\"><td>%zu</td><td>", family(row), number) +
                     escaped(row.name) + "</td>" + cell("%.0f", row.bytes_per_m);
  if (!row.measured) {
    return html + "<td colspan=\"11\" class=\"note\">not measured; " + escaped(row.note) +
           "</td></tr>\n";
  }
  const double planes = row.planes ? static_cast<double>(*row.planes) : NAN;
  html += cell("%.2f", static_cast<double>(row.bytes) / planes);
  html += cell("%.1f", row.reconstruction.accuracy_m * 1000);
  html += cell("%.1f", row.reconstruction.completeness_m * 1000);
  for (const double score : row.reconstruction.f_score) html += cell("%.3f", score);
  html += cell("%.1f", row.registration_error_m * 1000) +
          cell("%.1f", row.registration_origin_m * 1000);
  html += cell("%.3f", row.registration_turn_deg);
  html += text_of("<td>%zu of %zu</td>", row.failed, row.registrations);
  return html + cell("%.2f", row.encode_s) + cell("%.3f", row.decode_s) + "</tr>\n";
}

std::string table(const Comparison& comparison) {
  std::string html =
      "<div class=\"scroll\"><table>\n<tr><th></th><th>representation</th><th>bytes/m</th>"
      "<th>bytes/plane</th><th>accuracy, mm</th><th>completeness, mm</th><th>F 5 cm</th>"
      "<th>F 10 cm</th><th>F 20 cm</th><th>scan off, mm</th><th>origin, mm</th>"
      "<th>turned, deg</th><th>failed</th>"
      "<th>encode, s</th><th>decode, s</th></tr>\n";
  for (std::size_t k = 0; k < comparison.rows.size(); ++k) {
    html += table_row(comparison.rows[k], k + 1);
  }
  return html + "</table></div>\n";
}

}  // namespace

std::string to_html(const Comparison& comparison) {
  const Plot plots[] = {
      {"Size against the error of held-back scans that were registered to the map; left and low is "
       "better",
       "median error, mm", [](const auto& row) { return row.registration_error_m * 1000; }, true},
      {"Size against the F-score at 10 cm; left and high is better", "F-score at 10 cm",
       [](const auto& row) { return row.reconstruction.f_score[1]; }, false},
      {"Size against completeness: how far stacked points are from the map; left and low is better",
       "mean distance, mm",
       [](const auto& row) { return row.reconstruction.completeness_m * 1000; }, true},
  };
  std::string html =
      std::string(kHead) + "<p>Dataset " + escaped(comparison.dataset) +
      text_of(
          ": %zu scans over %.1f m, %zu of them held back and registered. Numbers in the plots "
          "are those of the table.</p>\n",
          comparison.scans, comparison.length_m, comparison.held_back);
  for (const Plot& plot : plots) html += figure(comparison, plot);
  return html + table(comparison) + "</body>\n</html>\n";
}

}  // namespace cellmap
