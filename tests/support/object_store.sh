#!/usr/bin/env bash
# A stand-in for an S3-compatible object store (npm's @20minutes/s3rver, which checks signatures), for tests.
# Usage: tests/support/object_store.sh start|stop FOLDER [MODULES]
# FOLDER then holds `address`: its URL. Its bucket is `cells`, the key and the secret are both S3RVER. MODULES (default: FOLDER's
# neighbour npm) keeps what npm installed. Where Node.js is absent it says so, and tests that need it are skipped.
set -euo pipefail

command=${1:?start or stop} folder=${2:?a folder}
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
modules=${3:-$(dirname "$folder")/npm-object-store}
if ! command -v npm >/dev/null || ! node -e 'process.exit(parseInt(process.versions.node) >= 20 ? 0 : 1)' 2>/dev/null; then
  echo "NO OBJECT STORE IS TESTED: its stand-in needs Node.js 20 or newer with npm, found $(node --version 2>/dev/null || echo none)"
  exit 0
fi

case $command in
  start)
    rm -rf "$folder"
    mkdir -p "$folder" "$modules"
    exec 9>"$modules/.lock" && flock 9
    cp "$here"/s3/{package.json,package-lock.json,.npmrc} "$modules/"
    stamp=$(sha256sum <"$modules/package-lock.json")
    if [[ $(cat "$modules/node_modules/.stamp" 2>/dev/null) != "$stamp" ]]; then
      if ! (cd "$modules" && npm ci --ignore-scripts --no-progress --loglevel=error); then
        echo "NO OBJECT STORE IS TESTED: npm cannot install its stand-in"
        exit 0
      fi
      echo "$stamp" >"$modules/node_modules/.stamp"
    fi
    flock -u 9
    mkdir "$folder/objects"
    setsid node --openssl-legacy-provider "$here/s3/serve.cjs" "$modules" "$folder/objects" cells \
      >"$folder/said" 2>"$folder/log" </dev/null 9>&- &
    echo $! >"$folder/pid"
    for _ in $(seq 100); do
      if [[ -s $folder/said ]]; then
        mv "$folder/said" "$folder/address"
        exit 0
      fi
      sleep 0.1
    done
    cat "$folder/log" >&2
    exit 1 ;;
  stop)
    [[ -f $folder/pid ]] && kill "$(cat "$folder/pid")" || true
    rm -rf "$folder" ;;
  *) echo "object_store.sh: unknown command '$command'" >&2; exit 2 ;;
esac
