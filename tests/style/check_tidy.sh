#!/usr/bin/env bash
# Whether clang-tidy 14 finds nothing in the library, the server and the client (.clang-tidy says what it looks for).
# It reads the groups of sources that the preset `release` compiles, so each header is read once a folder.
# Usage: tests/style/check_tidy.sh BUILD_DIR. Exit code 77 where there is no clang-tidy 14.
set -euo pipefail
cd "$(dirname "$0")/../.."
if ! command -v clang-tidy-14 >/dev/null; then
  echo "SKIPPED: no clang-tidy 14 (./install-dependencies.sh --with-clang-tidy)"
  exit 77
fi
build=$(realpath "${1:?the build folder}")
# Its own folder of commands, without GCC's precompiled header, which clang cannot read; cellmap_schema has to be built.
mkdir -p "$build/tidy"
mapfile -t units < <(python3 - "$build" <<'PY'
import json, pathlib, re, sys
build = pathlib.Path(sys.argv[1])
commands = json.loads((build / "compile_commands.json").read_text())
for command in commands:
    command["command"] = re.sub(r" -Winvalid-pch -include \S+", "", command["command"])
(build / "tidy/compile_commands.json").write_text(json.dumps(commands))
wanted = re.compile(re.escape(str(build)) + r"/(lib|server|client)/.*/unity_|/(lib/cellmap|server|client)/(?!CMakeFiles).*\.cpp$")
print("\n".join(sorted({c["file"] for c in commands if wanted.search(c["file"])})))
PY
)
printf '%s\0' "${units[@]}" |
  xargs -0 -n 1 -P "$(nproc)" clang-tidy-14 --quiet -p "$build/tidy" --extra-arg=-Wno-unknown-warning-option
echo "${#units[@]} groups are tidy"
