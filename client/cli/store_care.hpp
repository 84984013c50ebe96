#pragma once

namespace CLI {
class App;
}

namespace cellmap::cli {

class Verbs;

void add_store_care(CLI::App& app, Verbs& verbs);  // backup, check

}  // namespace cellmap::cli
