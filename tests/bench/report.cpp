#include "bench/report.hpp"

#include <sys/utsname.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <sstream>

namespace cellmap::bench {
namespace {

/// Four significant digits: more is noise.
double rounded(double value) {
  if (value == 0 || !std::isfinite(value)) return value;
  const double scale = std::pow(10.0, 3 - std::floor(std::log10(std::abs(value))));
  return std::round(value * scale) / scale;
}

std::string text(double value) {
  char buffer[32];
  const int digits = value >= 100 ? 0 : value >= 10 ? 1 : value >= 1 ? 2 : 3;
  std::snprintf(buffer, sizeof(buffer), "%.*f", digits, value);
  return buffer;
}

std::string processor() {
  std::ifstream file("/proc/cpuinfo");
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("model name")) return line.substr(line.find(':') + 2);
  }
  return "unknown processor";
}

std::string text_of(const nlohmann::json& extra, const char* key) {
  if (!extra.contains(key)) return "";
  return extra[key].is_string() ? extra[key].get<std::string>() : extra[key].dump();
}

bool was_disturbed(const Row& row) { return row.extra.value("kept", 1) == 0; }

/// What the stars and the rows' own notes say.
std::string notes(const std::vector<Row>& rows) {
  std::string text;
  if (std::any_of(rows.begin(), rows.end(), was_disturbed)) {
    text =
        "- \\*: the machine was busy and every pair was disturbed. The calmest third is shown; for "
        "one thread without the time it waited for a processor\n";
  }
  for (const Row& row : rows) {
    if (!row.extra.contains("note")) continue;
    const std::string note =
        "- " + row.name + " (" + row.data + "): " + row.extra["note"].get<std::string>() + "\n";
    if (text.find(note) == std::string::npos) text += note;
  }
  return text.empty() ? text : "\n" + text;
}

}  // namespace

Row duration_row(const std::string& name, int threads, const std::string& unit, double per_unit_s,
                 const Comparison& comparison, const std::string& data) {
  Row row{.name = name,
          .threads = threads,
          .unit = unit,
          .ours = comparison.ours_s / per_unit_s,
          .baseline = comparison.baseline_s / per_unit_s,
          .ratio = comparison.ratio,
          .data = data};
  row.extra["pairs"] = comparison.pairs;
  row.extra["kept"] = comparison.kept;
  return row;
}

std::string machine() {
  utsname system{};
  uname(&system);
  std::ostringstream stream;
  const double bytes =
      static_cast<double>(sysconf(_SC_PHYS_PAGES)) * static_cast<double>(sysconf(_SC_PAGE_SIZE));
  stream << processor() << ", " << sysconf(_SC_NPROCESSORS_ONLN) << " processors, "
         << std::lround(bytes / (1 << 30)) << " GiB, " << system.sysname << ' ' << system.release
         << ' ' << system.machine << "; " << CELLMAP_BENCH_COMPILER;
  return stream.str();
}

nlohmann::json to_json(const std::vector<Row>& rows) {
  nlohmann::json list = nlohmann::json::array();
  for (const Row& row : rows) {
    nlohmann::json entry = row.extra;
    for (auto& [key, value] : entry.items()) {
      const bool published = key == "paper_ms";
      if (value.is_number_float() && !published) value = rounded(value.get<double>());
    }
    entry["name"] = row.name;
    entry["threads"] = row.threads;
    entry["unit"] = row.unit;
    entry["ours"] = rounded(row.ours);
    entry["baseline"] = rounded(row.baseline);
    entry["ratio"] = rounded(row.ratio);
    entry["data"] = row.data;
    list.push_back(std::move(entry));
  }
  return {{"machine", machine()}, {"rows", list}};
}

std::string to_markdown(const std::vector<Row>& rows) {
  std::ostringstream out;
  out << "| row | data | threads | instructions | unit | ours | baseline | ratio | paper, ms |\n"
      << "|---|---|---|---|---|---|---|---|---|\n";
  for (const Row& row : rows) {
    out << "| " << row.name << " | " << row.data << " | " << row.threads << " | "
        << text_of(row.extra, "isa") << " | " << row.unit << " | " << text(row.ours) << " | "
        << text(row.baseline) << " | " << text(row.ratio) << 'x' << (was_disturbed(row) ? " *" : "")
        << " | " << text_of(row.extra, "paper_ms") << " |\n";
  }
  return out.str() + notes(rows);
}

}  // namespace cellmap::bench
