#!/usr/bin/env bash
# Writes man pages of what the programs say of themselves: cellmap.1, cellmap-VERB.1 for each verb, cellmapd.8.
# Usage: man_pages.sh CELLMAP CELLMAPD FOLDER     needs help2man
set -euo pipefail
cellmap=$1 cellmapd=$2 folder=$3
mkdir -p "$folder"
version=$("$cellmap" --version)

# page FILE TITLE SECTION SUMMARY COMMAND...
page() {
  local file=$1 title=$2 section=$3 summary=$4; shift 4
  help2man --no-info --section="$section" --version-string="${version/cellmap/CELLmap}" --name="$summary" \
    --source="${version/cellmap/CELLmap}" "$*" |
    sed -e "s/^\.TH [A-Z]*/.TH ${title^^}/" -e "s/^CELLmap \\\\- /${title} \\\\- /" >"$folder/$file"
}

page cellmap.1 cellmap 1 "elastic, lightweight LiDAR maps from the command line" "$cellmap"
page cellmapd.8 cellmapd 8 "serves CELLmaps over HTTP" "$cellmapd"
"$cellmap" --help | sed -n '/^Subcommands:/,/^$/p' | sed -n 's/^  \([a-z-]*\)  *\(.*\)/\1\t\2/p' |
  while IFS=$'\t' read -r verb summary; do
    page "cellmap-$verb.1" "cellmap-$verb" 1 "${summary,}" "$cellmap $verb" </dev/null
  done
