#!/usr/bin/env bash
# Kills cellmapd at random moments under many writers and checks what is left; crash.py says how.
# Usage: ./tests/crash/run.sh [--kills N] [--seed S] [--json FILE] [--cellmap FILE] [--cellmapd FILE] [--folder FOLDER]
set -euo pipefail
exec /usr/bin/python3 "$(dirname "$0")/crash.py" "$@"
