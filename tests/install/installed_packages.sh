#!/usr/bin/env bash
# Installs the Debian packages with dpkg, boots systemd there, runs the server as its unit, removes the packages again: in a
# throw-away copy of this machine (an overlay in memory, with namespaces of its own), so that nothing of it changes.
# Usage: installed_packages.sh FOLDER     FOLDER has the packages that packages.sh made. Exit code 77: not possible here.
set -euo pipefail
skip() { echo "THE PACKAGES ARE NOT INSTALLED IN A TEST: $*" >&2; exit 77; }
here=$(realpath "$(dirname "$0")")

if [[ ${1:-} != --inside ]]; then
  folder=$(realpath "$1")
  [[ $EUID -eq 0 ]] || skip "that needs root, to mount an overlay of this machine."
  for tool in unshare dpkg setpriv systemd-sysusers curl; do
    command -v "$tool" >/dev/null || skip "$tool is missing."
  done
  [[ -x /lib/systemd/systemd ]] || skip "systemd is missing."
  ls "$folder"/cellmap-server_*.deb >/dev/null 2>&1 || skip "there are no packages in $folder (packages.sh makes them)."
  unshare --mount --pid --fork true 2>/dev/null || skip "namespaces are not allowed here (a container without privileges?)."
  # A group of its own, so that the systemd in there does not find the processes out here.
  groups=$(mktemp -d) group=cellmap-packages-$$
  mount -t cgroup2 cgroup2 "$groups" 2>/dev/null || skip "cgroup2 cannot be mounted here."
  shared=$(mktemp -d)
  # Groups that systemd made, the innermost first.
  trap 'find "$groups/$group" -depth -type d -exec rmdir {} + 2>/dev/null; umount "$groups"; rmdir "$groups"; cp "$shared/boot" /tmp/see-boot; rm -rf "$shared"' EXIT
  mkdir "$groups/$group"
  cp "$folder"/*.deb "$here/installed_packages_check.sh" "$shared/"
  code=0
  (
    echo $BASHPID >"$groups/$group/cgroup.procs"
    exec timeout 300 unshare --mount --pid --fork --cgroup --uts --ipc --net --kill-child "$0" --inside "$shared"
  ) >"$shared/boot" 2>&1 </dev/null || code=$?
  cat "$shared/log" 2>/dev/null || cat "$shared/boot"
  [[ $code -ne 77 ]] || skip "$(tail -1 "$shared/boot")"
  [[ -e $shared/done ]] || { echo "It did not come to its end (code $code)."; exit 1; }
  exit 0
fi

shared=$2
overlay=$(mktemp -d)
mount -t tmpfs tmpfs "$overlay"
mkdir "$overlay"/{changed,work,root}
root=$overlay/root
mount -t overlay overlay -o "lowerdir=/,upperdir=$overlay/changed,workdir=$overlay/work" "$root" || skip "an overlay of / cannot be mounted here."
mount -t proc proc "$root/proc"
mount -t sysfs sysfs "$root/sys"
mount -t cgroup2 cgroup2 "$root/sys/fs/cgroup"
for at in run tmp dev; do mount -t tmpfs tmpfs "$root/$at"; done
chmod 1777 "$root/tmp"
mkdir "$root/dev/"{shm,pts}
ln -s pts/ptmx "$root/dev/ptmx"
for node in null:3 zero:5 full:7 random:8 urandom:9; do mknod -m 666 "$root/dev/${node%:*}" c 1 "${node#*:}"; done
ip link set lo up 2>/dev/null || true
mkdir "$root/run/packages"
mount --bind "$shared" "$root/run/packages"

# The first program in there: what a machine boots, with one thing to do, and then it is off.
mkdir -p "$root/run/systemd/system"
cat >"$root/run/systemd/system/check.service" <<'UNIT'
[Unit]
After=basic.target
[Service]
Type=oneshot
ExecStart=/bin/bash /run/packages/installed_packages_check.sh
StandardOutput=file:/run/packages/log
StandardError=file:/run/packages/log
ExecStopPost=/bin/sh -c 'systemctl --force exit $EXIT_STATUS'
UNIT
# Not chroot: units have mount namespaces of their own, which only a real root can be the beginning of.
mkdir "$root/run/outside"
cd "$root"
pivot_root . run/outside
umount --lazy /run/outside
exec env -i container=throwaway PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 \
  /lib/systemd/systemd --system --unit=check.service --log-target=console --show-status=no
