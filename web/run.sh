#!/usr/bin/env bash
# Checks, builds or tests the viewer in a folder of the build tree; nothing is written beside the sources.
# Usage: web/run.sh COMMAND... [--out DIR]     default DIR: build/web
#   prepare   mirror the sources, install the packages of package-lock.json, generate the schema's TypeScript
#   check     type check             build   dist/, what cellmapd --viewer serves
#   unit      unit tests             dev     Vite's development server (API: CELLMAP_URL, default 127.0.0.1:8080)
#   e2e CELLMAP CELLMAPD   tests in Chromium against the real programs (web/install-browser.sh installs Chromium)
#   measure CELLMAP CELLMAPD STORE MAP   time to the first picture, memory and bytes of the page on a map of yours
# Every command prepares first. Exit code 77: Node.js 20 or newer is missing, nothing was done.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(dirname "$here")
out=$root/build/web
arguments=()
while [[ $# -gt 0 ]]; do
  case $1 in
    --out) out=${2:?--out needs a folder}; shift 2 ;;
    -h|--help) sed -n '2,9s/^# \{0,1\}//p' "$0"; exit 0 ;;
    *) if [[ -f $1 ]]; then arguments+=("$(realpath "$1")"); else arguments+=("$1"); fi; shift ;;
  esac
done
set -- "${arguments[@]:-prepare}"

if ! command -v npm >/dev/null || ! node -e 'process.exit(parseInt(process.versions.node) >= 20 ? 0 : 1)' 2>/dev/null; then
  echo "THE VIEWER IS NOT BUILT OR TESTED: it needs Node.js 20 or newer with npm, found $(node --version 2>/dev/null || echo none)." >&2
  exit 77
fi

mkdir -p "$out"
exec 9>"$out/.lock" && flock 9
for name in src tests e2e api; do
  rm -rf "${out:?}/$name"
  [[ -d $here/$name ]] && cp -r "$here/$name" "$out/$name"
done
cp "$here"/{package.json,package-lock.json,.npmrc,tsconfig.json,vite.config.ts,vitest.e2e.config.ts} "$out/"
[[ -f $here/index.html ]] && cp "$here/index.html" "$out/"
cd "$out"
stamp=$(sha256sum package-lock.json)
if [[ $(cat node_modules/.stamp 2>/dev/null) != "$stamp" ]]; then
  npm ci --no-progress --loglevel=error
  echo "$stamp" >node_modules/.stamp
fi
flatc --ts -o schema "$root"/schema/*.fbs
export CELLMAP_SOURCE_DIR=$root
node api/build.mjs

command=$1; shift
case $command in
  prepare) ;;
  check) npm run --silent check ;;
  unit) npm run --silent unit ;;
  build) npm run --silent check && npm run --silent build ;;
  dev) flock -u 9; rm -rf src && ln -s "$here/src" src; npm run dev ;;
  e2e)
    if ! command -v chromium >/dev/null; then
      echo "THE VIEWER IS NOT TESTED IN A BROWSER: Chromium is missing (web/install-browser.sh installs Debian's)." >&2
      exit 77
    fi
    [[ -f dist/index.html ]] || npm run --silent build
    CELLMAP_PROGRAM=$1 CELLMAPD_PROGRAM=$2 npm run --silent e2e ;;
  measure)
    [[ -f dist/index.html ]] || npm run --silent build
    CELLMAP_PROGRAM=$1 CELLMAPD_PROGRAM=$2 CELLMAP_MEASURE_STORE=$3 CELLMAP_MEASURE_MAP=$4 \
      npx vitest run --config vitest.e2e.config.ts e2e/measure.test.ts ;;
  *) echo "run.sh: unknown command '$command'; see --help" >&2; exit 2 ;;
esac
