#include "client/cli/copy.hpp"

#include <CLI/CLI.hpp>
#include <memory>
#include <nlohmann/json.hpp>

#include "cellmap/client/json.hpp"
#include "cellmap/core/error.hpp"
#include "cellmap/store/copy_map.hpp"
#include "cellmap/store/open_store.hpp"
#include "client/cli/command_line.hpp"
#include "client/cli/interrupt.hpp"
#include "client/cli/map_text.hpp"
#include "client/cli/store_blobs.hpp"

namespace cellmap::cli {
namespace {

struct CopyArguments {
  std::string from, to;
  std::vector<std::string> maps;
};

std::vector<std::string> names_of(const Store& store) {
  std::vector<std::string> names;
  for (const MapInfo& map : store.maps()) names.push_back(map.name);
  return names;
}

void run_copy(const CopyArguments& options, const Console& console) {
  const auto from = open_store_to_read(options.from, objects_of_environment());
  const auto to = open_store(options.to, objects_of_environment());
  const Interrupt interrupt;
  client::Json copied = client::Json::array();
  std::string text;
  for (const std::string& name : options.maps.empty() ? names_of(*from) : options.maps) {
    ProgressBar bar(console, "copy " + name);
    const CopiedMap map =
        copy_map(*from, *to, name, interrupt.token(),
                 [&](std::uint64_t cells, std::uint64_t of) { bar.update(cells, of, "CELLs"); });
    copied.push_back({{"map", name}, {"cells", map.cells}, {"stored_bytes", map.stored_bytes}});
    text += format("%s: %s CELLs, %s, read back and compared\n", name.c_str(),
                   with_commas(map.cells).c_str(), human_bytes(double(map.stored_bytes)).c_str());
  }
  console.print({{"maps", copied}}, copied.empty() ? "there are no maps to copy\n" : text);
}

}  // namespace

void add_copy(CLI::App& app, Verbs& verbs) {
  const auto options = std::make_shared<CopyArguments>();
  CLI::App* verb = verbs.add(
      app, "copy", "Copy maps, with their history, from one store to another of any engine",
      "  cellmap copy map.db postgresql://cellmap@db/maps\n"
      "  cellmap copy postgresql://cellmap@db/maps map.db --map town\n"
      "Both may be served meanwhile, a file as the target may not. Each map is seen whole or not "
      "at "
      "all,\n"
      "after the bytes of all its CELLs were read back and compared. Jobs stay behind.\n",
      [options](const Console& console) { run_copy(*options, console); });
  verb->add_option("FROM", options->from, "A store: its file or postgresql://...")->required();
  verb->add_option("TO", options->to,
                   "A store: a file, made where it is missing, or postgresql://...")
      ->required();
  verb->add_option("--map", options->maps, "A map to copy; may be given again (default: all)");
}

}  // namespace cellmap::cli
