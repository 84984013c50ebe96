#!/usr/bin/env bash
# How cellmapd does under many clients, from other processes over loopback; load.py says what is measured.
# Usage: ./tests/load/run.sh [--seconds N] [--rows mixture,crowd,nginx,relocalising,overload] [--json FILE] [--cellmap FILE] [--cellmapd FILE]
# wrk and nginx-light (Debian packages) are used where they are; without them some rows are left out, and it says so.
set -euo pipefail
exec /usr/bin/python3 "$(dirname "$0")/load.py" "$@"
