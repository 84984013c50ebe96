#!/usr/bin/env bash
# Whether all C++ is as .clang-format has it. Exit code 77 where there is no clang-format 14: others break lines elsewhere.
set -euo pipefail
cd "$(dirname "$0")/../.."
if ! clang-format --version 2>/dev/null | grep -q 'version 14'; then
  echo "SKIPPED: no clang-format 14 (./install-dependencies.sh --with-clang-format)"
  exit 77
fi
mapfile -d '' files < <(find lib server client tests examples -path '*/node_modules' -prune -o -name '*.[ch]pp' -print0)
clang-format --dry-run --Werror "${files[@]}" && echo "${#files[@]} files are formatted"
