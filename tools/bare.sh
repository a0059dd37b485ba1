#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# Run `./run demo` and `./run test` from the README on bare systems without Node.js, compilers and Python. As root;
# takes 15 minutes and 4 GB per system.
#
# usage: bare.sh [SUITE...]   default: bookworm trixie noble, if offered
set -eu
cd -P "$(dirname "$0")/.."
PATH=$PATH:/usr/sbin:/sbin

say() { printf 'bare: %s\n' "$*" >&2; }
[ "$(id -u)" = 0 ] || { say "only root can make a bare system"; exit 1; }
command -v debootstrap >/dev/null || { say "debootstrap is missing: apt-get install debootstrap"; exit 1; }

failed=
for suite in ${*:-bookworm trixie noble}; do
   root=$PWD/build/bare/source-$suite
   rm -rf --one-file-system "$root"  # leftovers would hide missing packages
   mkdir -p "$root"
   if ! debootstrap --variant=minbase --include=ca-certificates "$suite" "$root" >"$root.log" 2>&1; then
      say "$suite could not be made: $root.log"
      [ $# = 0 ] || failed=1
      continue
   fi
   cp /etc/resolv.conf /etc/hosts "$root/etc/"
   cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"  # for networks with their own certificates
   git clone --quiet . "$root/srv/rockfall"
   mkdir -p "$root/dev/shm"
   mount -t proc proc "$root/proc"
   trap 'umount "$root/proc"' EXIT
   for command in demo test; do
      start=$(date +%s)
      status=0
      env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 \
         PIP_CERT=/etc/ssl/certs/ca-certificates.crt NODE_EXTRA_CA_CERTS=/etc/ssl/certs/ca-certificates.crt \
         chroot "$root" /srv/rockfall/run "$command" >"$root-$command.log" 2>&1 || status=$?
      say "$suite: ./run $command: exit $status, $(($(date +%s) - start)) s, $(tail -n 1 "$root-$command.log")"
      [ "$status" = 0 ] || failed=1
   done
   umount "$root/proc"
   trap - EXIT
done
[ -z "$failed" ]
