#!/bin/sh
# SPDX-License-Identifier: BSD-3-Clause
# Install the wheel of dist/ with pip in a bare Debian with Python but no compiler, as root, and run the first steps of
# the tutorial. The system stays in build/bare/SUITE. MOST: maximum seconds of installation and run.
#
# usage: bare_wheel.sh [SUITE]   bookworm (Python 3.11), trixie (3.13), sid (3.14)
set -eu
cd -P "$(dirname "$0")/.."
PATH=$PATH:/usr/sbin:/sbin

suite=${1-bookworm}
root=$PWD/build/bare/$suite
inside="env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LC_ALL=C.UTF-8 PIP_DISABLE_PIP_VERSION_CHECK=1"
[ -z "${PIP_CERT-}" ] || inside="$inside PIP_CERT=/srv/certificates.pem"
within() { chroot "$root" $inside "$@"; }
say() { printf 'bare-wheel: %s\n' "$*" >&2; }
fail() { say "$*"; exit 1; }

[ "$(id -u)" = 0 ] || fail "only root can make a bare system"
if [ ! -e "$root/srv/made" ]; then
   command -v debootstrap >/dev/null || fail "debootstrap is missing: apt-get install debootstrap"
   say "making $root"
   rm -rf "$root"
   mkdir -p "$root"
   debootstrap --variant=minbase --include=python3,python3-venv "$suite" "$root" >"$root.log" 2>&1 ||
      fail "debootstrap has failed: $root.log"
   touch "$root/srv/made"
fi

# Check that the system has no compiler, and nothing that the wheel must provide.
within true
for program in cc gcc gfortran meson; do
   ! within sh -c "command -v $program" || fail "$root is not bare: it has $program"
done
for library in libgfortran libgomp libquadmath liblapack libblas; do
   [ -z "$(find "$root/usr/lib" -name "$library*")" ] || fail "$root is not bare: it has $library"
done

tag=$(within python3 -c 'import sys; print("cp%d%d" % sys.version_info[:2])')
wheel=$(ls -t dist/rockfall-*-"$tag"-*manylinux*.whl 2>/dev/null | head -n 1)
[ -n "$wheel" ] || fail "dist/ has no wheel for $tag: ./run wheel"
rm -rf "$root/srv/case" "$root/srv/python" "$root/srv/"*.whl
cp "$wheel" "$root/srv/"
mkdir "$root/srv/case"
cp cases/tutorial/make_layers.py "$root/srv/case"
cp /etc/resolv.conf "$root/etc/resolv.conf"
[ -z "${PIP_CERT-}" ] || cp "$PIP_CERT" "$root/srv/certificates.pem"

steps="python make_layers.py
   rockfall new dem.tif site.gpkg -o case.nml
   rockfall check case.nml
   rockfall run case.nml --boulders-total 20000 --quiet -o result.nc
   rockfall lines result.nc
   rockfall prepare case.nml ready
   rockfall-batch ready/case.nml --shard 1/20"
mount -t proc proc "$root/proc"  # programs use it to find themselves and their libraries
trap 'umount "$root/proc"' EXIT
start=$(date +%s)
within sh -euc "
   cd /srv
   python3 -m venv python
   python/bin/pip install --quiet --no-cache-dir --only-binary :all: '$(basename "$wheel")[vector]'
   PATH=/srv/python/bin:\$PATH
   rockfall --version
   cd case
   $steps"
seconds=$(($(date +%s) - start))
say "$wheel in $suite: installed and run in $seconds s, $(du -sm "$root/srv/python" | cut -f1) MB"
[ "$seconds" -le "${MOST-120}" ] || fail "that is more than ${MOST-120} s"

# Results must be bit-identical to those of the build from source, if it exists.
if [ -x .venv/bin/rockfall ]; then
   rm -rf build/bare/case
   mkdir build/bare/case
   cp cases/tutorial/make_layers.py build/bare/case
   (PATH=$PWD/.venv/bin:$PATH && cd build/bare/case && sh -euc "$steps" >/dev/null)
   PYTHONPATH=tests .venv/bin/python - "$root/srv/case/result.nc" build/bare/case/result.nc <<'PY'
import sys
import rockfall
from same import same_numbers
one, other = map(rockfall.read_result, sys.argv[1:])
assert {*one.variables} == {*other.variables}
same_numbers(one, other)
print(f"bare-wheel: {len(one.variables)} variables have the bits of the build from source")
PY
fi
