#!/usr/bin/env bash
# What Bash completes for cellmap: verbs, flags, the values of a flag, files.
# Usage: completion.sh CELLMAP
set -euo pipefail
PATH=$(dirname "$(realpath "$1")"):$PATH
source "$(dirname "$0")/../../client/shell/cellmap.bash"
failed=0

# expect "words typed" reply... : all these replies are offered for the last word
expect() {
  local line=$1; shift
  read -ra COMP_WORDS <<<"$line"
  [[ $line == *' ' ]] && COMP_WORDS+=("")
  COMP_CWORD=$((${#COMP_WORDS[@]} - 1))
  _cellmap
  local reply
  for reply in "$@"; do
    printf '%s\n' "${COMPREPLY[@]}" | grep -qxF -e "$reply" && continue
    echo "'$line': expected '$reply' among: ${COMPREPLY[*]}" >&2
    failed=1
  done
}
never() {
  expect "$1"
  if printf '%s\n' "${COMPREPLY[@]}" | grep -qxF -e "$2"; then echo "'$1': did not expect '$2'" >&2; failed=1; fi
}

cd "$(dirname "$0")"
expect "cellmap rel" relocalise
expect "cellmap " build ingest serve archive
never "cellmap rel" build
expect "cellmap relocalise --pr" --prior --progress
expect "cellmap --v" --version
never "cellmap relocalise --pr" --route
expect "cellmap simulate --route-frame " auto camera sensor
expect "cellmap simulate --route-frame s" sensor
expect "cellmap export po" points
expect "cellmap verify comp" completion.sh
exit $failed
