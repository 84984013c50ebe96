#!/usr/bin/env bash
# What many servers over one database bear, tried with real faults, and what a map of a million CELLs costs; scale.py says how.
# Usage: ./tests/scale/run.sh [--rows ROW,...] [--short] [--json FILE] [--cellmap FILE] [--cellmapd FILE]
# It takes some minutes, PostgreSQL and HAProxy (./install-dependencies.sh --with-postgresql --with-proxies), and for some rows
# root; what is not there is left out, and it says so.
set -euo pipefail
exec /usr/bin/python3 "$(dirname "$0")/scale.py" "$@"
