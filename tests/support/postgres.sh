#!/usr/bin/env bash
# A PostgreSQL for tests: in a folder of its own, reached by a socket in it, gone afterwards.
# Usage: tests/support/postgres.sh start|stop FOLDER     Its address: postgresql:///postgres?host=FOLDER&user=postgres
# Where no server is installed it says so, and tests that need one are skipped.
set -euo pipefail

command=${1:?start or stop} folder=${2:?a folder}
bin=$(ls -d /usr/lib/postgresql/*/bin 2>/dev/null | sort -V | tail -n 1)
if [[ -z $bin ]]; then
  echo "no PostgreSQL server is installed (./install-dependencies.sh --with-postgresql)"
  exit 0
fi
# The server refuses to run as root.
as_server=()
[[ $EUID -ne 0 ]] || as_server=(setpriv --reuid postgres --regid postgres --init-groups)
# A path with a socket in it is at most 107 bytes long, so the data lie elsewhere; the folder names them.
run() { "${as_server[@]}" "$bin/$1" "${@:2}"; }

case $command in
  start)
    rm -rf "$folder"
    data=$(mktemp -d /tmp/cellmap-postgres-XXXXXX)
    [[ $EUID -ne 0 ]] || chown postgres:postgres "$data"
    run initdb --pgdata "$data/data" --username postgres --auth trust --encoding UTF8 --locale C >/dev/null
    run pg_ctl --pgdata "$data/data" --log "$data/log" --wait start \
      --options "-c listen_addresses='' -c unix_socket_directories='$data' -c fsync=off -c max_connections=200" >/dev/null
    ln -s "$data" "$folder" ;;
  stop)
    data=$(readlink "$folder")
    run pg_ctl --pgdata "$data/data" --mode immediate stop >/dev/null
    rm -rf "$data" "$folder" ;;
  *) echo "postgres.sh: unknown command '$command'" >&2; exit 2 ;;
esac
