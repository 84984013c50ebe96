#include "client/cli/store_care.hpp"

#include <CLI/CLI.hpp>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/client/backup.hpp"
#include "cellmap/client/json.hpp"
#include "cellmap/client/range_source.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/backup_store.hpp"
#include "cellmap/store/check_store.hpp"
#include "cellmap/store/store_place.hpp"
#include "client/cli/client_options.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/map_reader.hpp"
#include "client/cli/map_text.hpp"

// backup and check.

namespace cellmap::cli {
namespace {

namespace fs = std::filesystem;

struct BackupArguments {
  std::string from, file;
  double timeout_s = 120;
};

void fetch_backup(const BackupArguments& arguments, const Interrupt& interrupt,
                  const ByteProgress& progress) {
  if (fs::exists(arguments.file)) {
    throw Error(ErrorCode::kAlreadyExists,
                "'" + arguments.file + "' is there already; name another file");
  }
  Place place;
  place.server = arguments.from;
  place.timeout_s = arguments.timeout_s;
  const std::string part = arguments.file + ".part";
  try {
    const auto file = open_file(part, FileMode::kCreate);
    download_backup(client_options_of(place), *file, interrupt.token(), progress);
    file->sync();
    fs::rename(part, arguments.file);
  } catch (...) {
    std::error_code ignored;
    fs::remove(part, ignored);
    throw;
  }
}

/// What looks into the file itself has nothing to look into there.
void require_file(const std::string& store, const char* instead) {
  if (!is_postgres_address(store)) return;
  throw Error(ErrorCode::kUnsupported,
              std::string("a store in PostgreSQL has no file; ") + instead);
}

void backup(const BackupArguments& arguments, const Console& console) {
  require_file(arguments.from, "use pg_dump, or 'cellmap copy' into a file");
  const Interrupt interrupt;
  {
    ProgressBar bar(console, "backup");
    const auto progress = [&](std::uint64_t done, std::uint64_t total) {
      bar.update(done, total, "bytes");
    };
    if (is_http_url(arguments.from)) {
      fetch_backup(arguments, interrupt, progress);
    } else {
      backup_store(arguments.from, arguments.file, interrupt.token(), progress);
    }
  }
  const auto bytes = fs::file_size(arguments.file);
  console.print(
      {{"file", arguments.file}, {"bytes", bytes}},
      format("%s: a store of %s\n", arguments.file.c_str(), human_bytes(double(bytes)).c_str()));
}

struct CheckArguments {
  std::string store;
  bool repair = false;
};

client::Json to_json(const StoreReport& report) {
  client::Json findings = client::Json::array();
  for (const StoreFinding& finding : report.findings) {
    client::Json json = {{"damage", to_string(finding.damage)},
                         {"map", nullptr},
                         {"cell", nullptr},
                         {"what", finding.what}};
    if (!finding.map.empty()) json["map"] = finding.map;
    if (finding.cell) json["cell"] = finding.cell->value;
    findings.push_back(std::move(json));
  }
  return {{"schema", report.schema},       {"maps", report.maps},
          {"cells", report.cells},         {"contents", report.contents},
          {"bytes", report.content_bytes}, {"findings", std::move(findings)},
          {"notes", report.notes},         {"intact", report.findings.empty()}};
}

std::string to_text(const std::string& file, const StoreReport& report) {
  std::string text = format(
      "%s: %s maps, %s CELLs, %s contents of %s, schema %lld: %s\n", file.c_str(),
      with_commas(report.maps).c_str(), with_commas(report.cells).c_str(),
      with_commas(report.contents).c_str(), human_bytes(double(report.content_bytes)).c_str(),
      static_cast<long long>(report.schema), report.findings.empty() ? "intact" : "DAMAGED");
  for (const StoreFinding& finding : report.findings) {
    text += "  " + std::string(to_string(finding.damage)) + "  ";
    if (!finding.map.empty()) text += "map " + finding.map + ": ";
    if (finding.cell) text += "CELL " + std::to_string(finding.cell->value) + ": ";
    text += finding.what + "\n";
  }
  for (const std::string& note : report.notes) text += "  note  " + note + "\n";
  return text;
}

StoreReport checked(const std::string& file, const Console& console) {
  const Interrupt interrupt;
  ProgressBar bar(console, "check");
  return check_store(file, interrupt.token(), [&](std::uint64_t done, std::uint64_t total) {
    bar.update(done, total, "CELLs");
  });
}

void check(const CheckArguments& arguments, const Console& console) {
  require_file(arguments.store, "'cellmap copy' into a file reads and compares all of it");
  const StoreReport before = checked(arguments.store, console);
  if (!arguments.repair || before.findings.empty()) {
    console.print(to_json(before), to_text(arguments.store, before));
    if (before.findings.empty()) return;
    throw Error(ErrorCode::kCorruptData,
                "'" + arguments.store +
                    "' is damaged; restore a backup, or keep a copy and mend what can be mended "
                    "with --repair");
  }
  const StoreRepair repair = repair_store(arguments.store);
  const StoreReport after = checked(arguments.store, console);
  std::string text = to_text(arguments.store, before);
  for (const std::string& line : repair.done) text += "  mended  " + line + "\n";
  for (const std::string& line : repair.lost) text += "  LOST  " + line + "\n";
  text += "after the repair:\n" + to_text(arguments.store, after);
  client::Json json = to_json(after);
  json["before"] = to_json(before);
  json["mended"] = repair.done;
  json["lost"] = repair.lost;
  console.print(json, text);
  if (!after.findings.empty()) {
    throw Error(ErrorCode::kCorruptData,
                "'" + arguments.store + "' is still damaged; restore a backup");
  }
}

}  // namespace

void add_store_care(CLI::App& app, Verbs& verbs) {
  const auto backed_up = std::make_shared<BackupArguments>();
  CLI::App* verb = verbs.add(
      app, "backup", "Copy a whole store while it is served",
      "  cellmap backup map.db map-monday.db\n"
      "  cellmap backup http://127.0.0.1:8080 map-monday.db\n"
      "The copy is a store, of one moment. To restore it, stop the server and put it where the\n"
      "store was, without the -wal and -shm files that lie there.\n",
      [backed_up](const Console& console) { backup(*backed_up, console); });
  verb->add_option("FROM", backed_up->from, "A store's file, or the http:// address of a server")
      ->required();
  verb->add_option("FILE", backed_up->file, "File to write; must not be there yet")->required();
  verb->add_option("--timeout", backed_up->timeout_s,
                   "How long one request may take, seconds: the server copies before it answers")
      ->capture_default_str();

  const auto checked = std::make_shared<CheckArguments>();
  CLI::App* look =
      verbs.add(app, "check", "Read a whole store and say what is wrong with it",
                "  cellmap check map.db\n"
                "  cp map.db map-before.db && cellmap check map.db --repair\n"
                "Checks the file's structure, every reference, sum and revision, and the bytes of "
                "every CELL\n"
                "against their hash. May run while the store is served; --repair may not.\n",
                [checked](const Console& console) { check(*checked, console); });
  look->add_option("STORE", checked->store, "A store's file")->required();
  look->add_flag("--repair", checked->repair,
                 "Mend what can be mended, and say what is lost by that");
}

}  // namespace cellmap::cli
