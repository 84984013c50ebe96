#!/usr/bin/env bash
# Installs what is missing, builds and runs all tests.
# Usage: ./tests/run.sh [PRESET] [CTEST ARGUMENTS...]     PRESET: release (default), debug, asan, tsan
set -euo pipefail
cd "$(dirname "$0")/.."
./install-dependencies.sh --with-postgresql --with-clang-format
preset=${1:-release}
[[ $# -gt 0 ]] && shift
export CELLMAP_DATA=${CELLMAP_DATA:-$PWD/../shared/data}
cmake --preset "$preset"
cmake --build --preset "$preset"
ctest --preset "$preset" "$@"
