#!/usr/bin/env bash
# Installs the Debian 12 packages that CELLmap builds with, and says which. Does nothing where they are all there.
# Usage: ./install-dependencies.sh [--without-pcl] [--with-proxies] [--with-fuzzers] [--with-postgresql] [--with-clang-format] [--with-clang-tidy]
set -euo pipefail

packages=(
  g++ cmake ninja-build ccache pkg-config python3 curl ca-certificates
  libeigen3-dev libflatbuffers-dev flatbuffers-compiler libzstd-dev libssl-dev libxxhash-dev
  libceres-dev libtbb-dev libembree-dev libgeographiclib-dev libsqlite3-dev libsqlitecpp-dev libpq-dev libcurl4-openssl-dev
  libcpp-httplib-dev nlohmann-json3-dev libcli11-dev libspdlog-dev prometheus-cpp-dev
  librosbag-storage-dev libsensor-msgs-dev libnav-msgs-dev libhwy-dev libgtest-dev libgmock-dev libbenchmark-dev libnanoflann-dev python3-jsonschema python3-yaml
  python3-numpy python3-zstandard python3-xxhash python3-pytest python3-matplotlib python3-setuptools python3-pip mypy help2man dpkg-dev
)
# PCL is large (1 GB installed); only the command line's PCD and PLY support and some rows of
# `cellmap compare` need it, and Draco.
[[ " $* " == *" --without-pcl "* ]] || packages+=(libpcl-dev libdraco-dev)
# Debian starts these as soon as they are installed, so only who asks gets them; their tests are skipped without.
[[ " $* " != *" --with-proxies "* ]] || packages+=(nginx-light haproxy openssl iproute2)
# Only the fuzz targets need a second compiler (600 MB installed).
[[ " $* " != *" --with-fuzzers "* ]] || packages+=(clang-14 libclang-rt-14-dev)

# The engine of large fleets, for its tests; no database is made or started by installing it here.
[[ " $* " != *" --with-postgresql "* ]] || packages+=(postgresql-15)
[[ " $* " != *" --with-clang-format "* ]] || packages+=(clang-format)
[[ " $* " != *" --with-clang-tidy "* ]] || packages+=(clang-tidy-14)

missing=()
for package in "${packages[@]}"; do
  status=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
  [[ "$status" == installed ]] || missing+=("$package")
done
[[ ${#missing[@]} -eq 0 ]] && exit 0

if [[ $EUID -eq 0 ]]; then
  as_root=()
elif command -v sudo >/dev/null; then
  as_root=(sudo)
else
  echo "These Debian packages are missing and installing them needs root or sudo: ${missing[*]}" >&2
  exit 1
fi
echo "Installing ${#missing[@]} Debian packages: ${missing[*]}"
"${as_root[@]}" apt-get update -qq
if [[ " ${missing[*]} " == *" postgresql-15 "* ]]; then
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends postgresql-common >/dev/null
  "${as_root[@]}" sed -i "s/^#\?create_main_cluster.*/create_main_cluster = false/" /etc/postgresql-common/createcluster.conf
fi
"${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
  apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
