#!/usr/bin/env bash
# Three robots map one simulated town at the same time, each starting somewhere else on its route and knowing nothing of
# the others; one server makes one map of it. Builds what is missing; three_robots.py does it and says what it prints.
# Usage: ./examples/three_robots.sh [--small] [--folder FOLDER]     --small: around a block, in a minute
set -euo pipefail
cd "$(dirname "$0")/.."
[[ -x build/release/client/cellmap && -x build/release/server/cellmapd ]] || {
  ./install-dependencies.sh
  cmake --preset release
  cmake --build --preset release --target cellmap_cli cellmapd
}
exec python3 examples/three_robots.py "$@"
