#!/usr/bin/env bash
# The kernel lab: hardware backends and the shipped daemon against a real kernel's V4L2 and GPIO, in a QEMU guest.
# Installs what is missing, builds the guest (about six minutes from nothing, then cached), and prints how many tests
# passed and failed. A guest that cannot be built is a failure, and says why.
#   --preset NAME   build preset of CMakePresets.json whose programs are tested (default: dev); built where they are not
#   --cache FOLDER  where guests are kept (default: BRDFGATE_LAB_CACHE, else brdfgate-lab in the user's cache)
set -euo pipefail
cd "$(dirname "$0")/../.."

preset=dev
cache=${BRDFGATE_LAB_CACHE:-${XDG_CACHE_HOME:-${HOME:-/root}/.cache}/brdfgate-lab}
while [ $# -gt 0 ]; do
  case "$1" in
    --preset) preset=${2:?--preset needs a name}; shift ;;
    --cache) cache=${2:?--cache needs a folder}; shift ;;
    *) echo "error: unknown option $1 (known: --preset NAME, --cache FOLDER)" >&2; exit 2 ;;
  esac
  shift
done

# shellcheck source=app/packages.sh
. app/packages.sh
app/install_packages.sh "${BUILD_PACKAGES[@]}" "${TEST_PACKAGES[@]}" "${KERNEL_LAB_PACKAGES[@]}"

echo "== kernel lab: the guest"
mkdir -p "$cache"
# One at a time: QEMU without KVM takes every core it gets.
exec 9>"$cache/lock"
flock 9
guest=$(nice tests/kernel/build_guest.sh "$cache")

echo "== kernel lab: the programs (preset $preset)"
[ -e "build/$preset/build.ninja" ] || cmake --preset "$preset"
cmake --build --preset "$preset" --target brdfgate brdfgated camera_contract lab_gpio lab_camera lab_bench

echo "== kernel lab: running"
exec nice /usr/bin/python3 -B tests/kernel/test_lab.py "$guest" "build/$preset"
