#!/usr/bin/env bash
# Installs the Python client as Debian's pip does without the network, and plots an archive with the installed package.
# Usage: plot_with_python.sh CELLMAP FOLDER     Exit code 77: a Debian package is missing.
set -euo pipefail
cellmap=$1 folder=$2
python_client=$(cd "$(dirname "$0")/../../client/python" && pwd)
/usr/bin/python3 -c 'import matplotlib' 2>/dev/null || {
  echo "THE PYTHON EXAMPLE IS NOT TESTED: python3-matplotlib is missing (./install-dependencies.sh)." >&2
  exit 77
}
rm -rf "$folder" && mkdir -p "$folder"
"$python_client/run.sh" install "$folder/site"
"$cellmap" simulate --route town --scans 40 --columns 500 --out "$folder/drive" --json >/dev/null
"$cellmap" build "$folder/drive" --store "$folder/map.db" --map town --session monday --lattice-size 20000 --json >/dev/null
"$cellmap" archive town --store "$folder/map.db" --encoding compact --bound 20mm --out "$folder/town.cellmap" >/dev/null
cd "$folder"
export PYTHONPATH=$folder/site MPLCONFIGDIR=$folder/matplotlib PYTHONDONTWRITEBYTECODE=1
/usr/bin/python3 -c "
import cellmap, pathlib
assert pathlib.Path(cellmap.__file__).is_relative_to('$folder'), cellmap.__file__
assert (pathlib.Path(cellmap.__file__).parent / 'py.typed').exists()"
/usr/bin/python3 "$python_client/examples/plot_map.py" town.cellmap - map.png
# A picture of something: a blank one of this size compresses to a few kilobytes.
size=$(stat -c %s map.png)
[[ $(head -c 4 map.png | tail -c 3) == PNG && $size -gt 20000 ]] || { echo "map.png has $size bytes" >&2; exit 1; }
