#!/usr/bin/env bash
# Tests, type-checks or installs the Python client with what Debian ships; nothing is written beside the sources.
# Usage: client/python/run.sh test [CELLMAP CELLMAPD]   pytest; with the built programs also against a real server
#        client/python/run.sh types                     mypy --strict
#        client/python/run.sh install PREFIX            pip install, from a copy, without the network
# Exit code 77: a Debian package is missing, nothing was done.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
python=/usr/bin/python3
export PYTHONDONTWRITEBYTECODE=1

need() {
  for module in "$@"; do
    "$python" -c "import $module" 2>/dev/null && continue
    echo "THE PYTHON CLIENT IS NOT TESTED: $python lacks $module (Debian: python3-$module; ./install-dependencies.sh)." >&2
    exit 77
  done
}

command=${1:-}; shift || true
case $command in
  test)
    need numpy zstandard xxhash pytest
    [[ $# -eq 0 ]] || { CELLMAP_PROGRAM=$(realpath "$1"); CELLMAPD_PROGRAM=$(realpath "$2"); export CELLMAP_PROGRAM CELLMAPD_PROGRAM; }
    PYTHONPATH=$here/src exec "$python" -m pytest -q -p no:cacheprovider "$here/tests" ;;
  types)
    command -v mypy >/dev/null || { echo "THE PYTHON CLIENT'S TYPES ARE NOT CHECKED: mypy is missing (Debian: mypy)." >&2; exit 77; }
    cd "$here" && exec mypy --python-executable "$python" --cache-dir /dev/null src/cellmap examples ;;
  install)
    need numpy zstandard xxhash pip setuptools
    prefix=$(realpath -m "${1:?install needs a prefix}")
    copy=$(mktemp -d) && trap 'rm -rf "$copy"' EXIT
    cp -r "$here/src" "$here/pyproject.toml" "$here/README.md" "$copy/"
    "$python" -m pip install --quiet --no-index --no-build-isolation --no-deps --no-warn-script-location --root-user-action=ignore \
      --disable-pip-version-check --upgrade --target "$prefix" "$copy" ;;
  *) sed -n '2,6s/^# \{0,1\}//p' "$0" >&2; exit 2 ;;
esac
