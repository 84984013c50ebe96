#!/usr/bin/env bash
# Installs Debian's Chromium for the viewer's tests in a browser. Does nothing where it is there.
set -euo pipefail
command -v chromium >/dev/null && exit 0
if [[ $EUID -eq 0 ]]; then
  as_root=()
elif command -v sudo >/dev/null; then
  as_root=(sudo)
else
  echo "Installing chromium needs root or sudo." >&2
  exit 1
fi
"${as_root[@]}" apt-get update -qq
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
  apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core >/dev/null
