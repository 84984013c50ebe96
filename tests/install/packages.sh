#!/usr/bin/env bash
# Makes the Debian packages, lays them out in a folder of their own, and runs what is in them there.
# Usage: packages.sh BUILD_DIR FOLDER     Exit code 77: a tool is missing.
set -euo pipefail
build=$(realpath "$1") folder=$(realpath -m "$2")
for tool in dpkg-deb dpkg-shlibdeps curl; do
  command -v "$tool" >/dev/null || { echo "THE PACKAGES ARE NOT TESTED: $tool is missing." >&2; exit 77; }
done
fail() { echo "$*" >&2; exit 1; }
field() { dpkg-deb -f "$1" "$2"; }

rm -rf "$folder" && mkdir -p "$folder/root"
cd "$build"
cmake --build . --target help >"$folder/targets.log"
if grep -q '^man:' "$folder/targets.log"; then cmake --build . --target man >/dev/null; fi
cpack -G DEB -B "$folder" >"$folder/cpack.log" 2>&1 || { cat "$folder/cpack.log" >&2; exit 1; }
cd "$folder"
rm -rf _CPack_Packages
for name in cellmap cellmap-server libcellmap-dev python3-cellmap; do
  file=$(ls "${name}"_*.deb) || fail "There is no package $name."
  [[ $(field "$file" Package) == "$name" ]] || fail "$file calls itself $(field "$file" Package)."
  dpkg-deb -x "$file" root
done
[[ $(field cellmap-server_*.deb Depends) == *libsqlite3-0* ]] || fail "cellmap-server does not ask for its libraries."
[[ $(field python3-cellmap_*.deb Depends) == *python3-numpy* ]] || fail "python3-cellmap does not ask for numpy."
[[ $(field python3-cellmap_*.deb Architecture) == all ]] || fail "python3-cellmap is for one architecture only."
unit=root/usr/lib/systemd/system/cellmapd.service
[[ $(grep -o '^ExecStart=[^ ]*' "$unit") == ExecStart=/usr/bin/cellmapd ]] || fail "The unit starts $(grep ExecStart "$unit")."
[[ $(dpkg-deb --ctrl-tarfile cellmap-server_*.deb | tar -t) == *postinst* ]] || fail "cellmap-server makes no user."
[[ $(dpkg-deb -c cellmap_*.deb) != *bin/cellmapd* ]] || fail "The client's package holds the server."

root=$folder/root/usr
"$root/bin/cellmap" simulate --route town --scans 30 --columns 400 --out drive --json >/dev/null
"$root/bin/cellmap" build drive --store map.db --map town --session monday --lattice-size 20000 --json >/dev/null
"$root/bin/cellmapd" --store map.db --listen 127.0.0.1:0 --threads 1 --log-level error >server.log & server=$!
trap 'kill $server 2>/dev/null; wait $server 2>/dev/null || true' EXIT
for _ in $(seq 100); do url=$(grep -o 'http://[^ ]*' server.log || true); [[ -n $url ]] && break; sleep 0.2; done
curl -sf "$url/v1/maps/town" | grep -q '"cells"' || fail "The packaged server does not serve the map."
if [[ -d $root/share/cellmap/web/assets ]]; then
  curl -sf "$url/" | grep -q 'assets/' || fail "The packaged server does not serve the packaged viewer."
fi
PYTHONPATH=$root/lib/python3/dist-packages PYTHONDONTWRITEBYTECODE=1 /usr/bin/python3 -c "
import sys, cellmap
assert cellmap.__file__.startswith('$root'), cellmap.__file__
client = cellmap.Client('$url')
assert len(dict(client.load_cells('town'))) == client.map('town').cells > 1" ||
  { /usr/bin/python3 -c 'import numpy, zstandard, xxhash' 2>/dev/null && fail "The packaged Python client does not work."; }
if [[ -d $build/man ]]; then
  man -l "$root"/share/man/man1/cellmap-relocalise.1* 2>/dev/null | grep -q 'prior' || [[ ! -x /usr/bin/man ]] ||
    fail "There is no man page of cellmap relocalise."
fi
[[ -f $root/share/bash-completion/completions/cellmap ]] || fail "The shell's completion is missing."
[[ -f $root/include/cellmap/client/client.hpp ]] || fail "The headers are missing."
