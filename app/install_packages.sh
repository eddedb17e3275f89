#!/usr/bin/env bash
# Installs the Debian packages named on the command line that are missing. Says what it does and stops with
# a clear message where apt cannot. Used by app/demo.sh and tests/run.sh.
set -euo pipefail

missing=()
for package in "$@"; do
  dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q '^install ok installed$' || missing+=("$package")
done
if [ ${#missing[@]} -eq 0 ]; then
  exit 0
fi

echo "== installing ${#missing[@]} missing Debian package(s): ${missing[*]}"
as_root=()
if [ "$(id -u)" -ne 0 ]; then
  command -v sudo >/dev/null || { echo "error: not root and no sudo; install by hand: ${missing[*]}" >&2; exit 2; }
  as_root=(sudo)
fi
export DEBIAN_FRONTEND=noninteractive
log=$(mktemp)
trap 'rm -f "$log"' EXIT
# An update that fails is not yet the end: the lists may be recent enough.
"${as_root[@]}" apt-get -q update >"$log" 2>&1 || echo "   apt-get update failed; trying with the lists at hand"
if ! "${as_root[@]}" apt-get -q install -y --no-install-recommends "${missing[@]}" >"$log" 2>&1; then
  tail -n 5 "$log" >&2
  echo "error: apt-get could not install: ${missing[*]}" >&2
  echo "       Is a Debian 12 (or newer) package registry reachable? 'apt-get update' tells." >&2
  exit 2
fi
