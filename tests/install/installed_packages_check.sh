#!/usr/bin/env bash
# What installed_packages.sh runs under systemd, in the throw-away copy of a machine, as an operator would (README.md).
set -euo pipefail
cd /run/packages
export PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root DEBIAN_FRONTEND=noninteractive
fail() { echo "FAILED: $*"; journalctl -u cellmapd --no-pager -n 30 2>/dev/null || true; exit 1; }
step() { echo "- $*"; }
files() { find /usr /etc /var -xdev \( -path /var/lib/dpkg -o -path /var/log -o -path /var/cache \) -prune -o -print | sort; }
active() { [[ $(systemctl is-active cellmapd) == "$1" ]]; }
# Not by a pipe: grep ends at the first match, and curl would complain.
holds() { curl -sf -o page -H "Authorization: Bearer ${3:-}" "http://127.0.0.1:8080$1" && grep -q "$2" page; }
ready() { for _ in $(seq 100); do curl -sf -o ready http://127.0.0.1:8080/readyz && return; sleep 0.2; done; return 1; }

files >before
step "dpkg installs all four: their dependencies have the names and versions of Debian's packages"
dpkg --install ./*.deb >dpkg.log 2>&1 || { cat dpkg.log; fail "dpkg refuses them."; }
dpkg --audit | grep . && fail "dpkg finds them half installed."
dpkg --verify cellmap cellmap-server libcellmap-dev python3-cellmap | grep . && fail "files are not what their package says."
for program in cellmap cellmapd; do
  ldd /usr/bin/$program | grep 'not found' && fail "$program lacks a library."
done

step "its user and folder are there, and nobody else may look into it"
[[ $(getent passwd cellmap) == *:/var/lib/cellmap:/usr/sbin/nologin ]] || fail "user: $(getent passwd cellmap)"
[[ $(stat -c '%U %a' /var/lib/cellmap) == "cellmap 700" ]] || fail "folder: $(stat -c '%U %a' /var/lib/cellmap)"
[[ $(dpkg-query -W -f '${Conffiles}' cellmap-server) == *" /etc/cellmap/cellmapd.conf "* ]] || fail "its settings are no conffile."

step "systemd knows the unit, and starts nothing unasked"
systemctl cat cellmapd >unit || fail "there is no unit."
systemd-analyze verify /usr/lib/systemd/system/cellmapd.service >verify 2>&1 || { cat verify; fail "systemd does not take the unit."; }
active inactive || fail "it runs unasked."

step "the unit runs with the first token that README makes"
token=$(cellmap token create me --tokens /var/lib/cellmap/tokens --scope admin)
systemctl enable --now cellmapd 2>/dev/null || { systemctl status cellmapd || true; fail "it does not start."; }
ready || fail "it is not ready."
[[ $(ps -o user= -C cellmapd) == cellmap ]] || fail "it runs as $(ps -o user= -C cellmapd)."
[[ -d /var/log/cellmap && $(stat -c %U /var/log/cellmap) == cellmap ]] || fail "no folder for its audit log."
[[ $(curl -s -o /dev/null -w '%{http_code}' http://127.0.0.1:8080/v1/maps) == 401 ]] || fail "it serves strangers."

step "a drive goes in, the map comes out: command line, Python, viewer, manual"
cd /tmp
cellmap simulate --route town --scans 30 --columns 400 --out drive --json >/dev/null
export CELLMAP_TOKEN=$token
cellmap ingest drive --server http://127.0.0.1:8080 --map town --lattice-size 20000 --json >ingest.json || fail "ingest."
cellmap info town --server http://127.0.0.1:8080 --json >info.json || fail "info."
/usr/bin/python3 -c "
import cellmap
assert cellmap.__file__.startswith('/usr/lib/python3/dist-packages/'), cellmap.__file__
client = cellmap.Client('http://127.0.0.1:8080', '$token')
assert len(dict(client.load_cells('town'))) == client.map('town').cells > 1" || fail "the Python package."
if [[ -d /usr/share/cellmap/web ]]; then
  holds / assets/ || fail "the viewer."
  holds /api/ 'CELLmap API' || fail "the API reference."
else
  echo "  (the viewer was not built and is not in the package)"
fi
grep -q '"caller":"me"' /var/log/cellmap/audit.jsonl || fail "the audit log: $(head -3 /var/log/cellmap/audit.jsonl)"

step "reload reads tokens again; a killed server comes back with its map"
second=$(cellmap token create cart --tokens /var/lib/cellmap/tokens --scope map:read)
systemctl reload cellmapd
for _ in $(seq 50); do holds /v1/maps '"town"' "$second" && break; sleep 0.1; done
holds /v1/maps '"town"' "$second" || fail "the new token is not known."
systemctl kill --signal KILL cellmapd
sleep 1 && ready || fail "it does not come back."
holds /v1/maps '"town"' "$second" || fail "the map is gone."
[[ $(systemctl show -p NRestarts --value cellmapd) == 1 ]] || fail "systemd did not start it again."

step "the same packages once more, as an upgrade: settings stay, the server runs on"
echo '# mine' >>/etc/cellmap/cellmapd.conf
before=$(systemctl show -p MainPID --value cellmapd)
dpkg --force-confdef --force-confold --install /run/packages/cellmap-server_*.deb >/run/packages/dpkg.log 2>&1 || fail "upgrade."
tail -1 /etc/cellmap/cellmapd.conf | grep -q mine || fail "settings were overwritten."
ready && active active || fail "it does not run after the upgrade."
[[ $(systemctl show -p MainPID --value cellmapd) != "$before" ]] || fail "the old program runs on."

step "removed, nothing runs and settings and maps are there; purged, only maps are"
dpkg --remove cellmap-server cellmap libcellmap-dev python3-cellmap >/run/packages/dpkg.log 2>&1 || fail "removal."
active inactive || fail "it runs on."
[[ -f /etc/cellmap/cellmapd.conf && -f /var/lib/cellmap/maps.db ]] || fail "settings or maps are gone."
dpkg --purge cellmap-server >>/run/packages/dpkg.log 2>&1 || fail "purge."
rm -r /var/lib/cellmap
cd /run/packages
files >after
comm -13 before after | grep -v -e '^/etc/\(passwd\|group\|shadow\|gshadow\)-\?$' -e '^/var/lib/systemd' >left || true
comm -23 before after >lost
[[ ! -s left && ! -s lost ]] || fail "left or lost: $(cat left lost)"
touch done
