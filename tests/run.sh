#!/usr/bin/env bash
# Installs what is missing, builds and runs all tests.
# Usage: ./tests/run.sh [PRESET] [CTEST ARGUMENTS...]     PRESET: release (default), debug, asan, tsan
#        ./tests/run.sh all [STAGE...]                    what continuous integration runs (tests/stages.sh)
set -euo pipefail
cd "$(dirname "$0")/.."
if [[ ${1:-} == all ]]; then
  ./install-dependencies.sh --with-postgresql --with-clang-format --with-clang-tidy
  exec ./tests/stages.sh "${@:2}"
fi
./install-dependencies.sh --with-postgresql --with-clang-format
preset=${1:-release}
[[ $# -gt 0 ]] && shift
export CELLMAP_DATA=${CELLMAP_DATA:-$PWD/../shared/data}
cmake --preset "$preset"
cmake --build --preset "$preset"
ctest --preset "$preset" "$@"
