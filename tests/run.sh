#!/usr/bin/env bash
# Installs what is missing, builds, and runs every test. Options:
#   --lint         also check clang-format and clang-tidy (as continuous integration does)
#   --preset NAME  build preset of CMakePresets.json (default: dev)
set -euo pipefail
cd "$(dirname "$0")/.."

lint=no
preset=dev
while [ $# -gt 0 ]; do
  case "$1" in
    --lint) lint=yes ;;
    --preset) preset=${2:?--preset needs a name}; shift ;;
    *) echo "error: unknown option $1 (known: --lint, --preset NAME)" >&2; exit 2 ;;
  esac
  shift
done

# shellcheck source=app/packages.sh
. app/packages.sh
packages=("${BUILD_PACKAGES[@]}" "${TEST_PACKAGES[@]}")
[ "$lint" = no ] || packages+=("${LINT_PACKAGES[@]}")
app/install_packages.sh "${packages[@]}"

echo "== configuring and building (preset $preset)"
cmake --preset "$preset"
cmake --build --preset "$preset"

if [ "$lint" = yes ]; then
  tests/lint.sh "build/$preset"
fi

echo "== running every test"
ctest --preset "$preset" --parallel "$(nproc)"
