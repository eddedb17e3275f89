#!/usr/bin/env bash
# clang-format and clang-tidy over every source file; any finding is an error.
#   tests/lint.sh BUILD_DIR      (a configured build with compile_commands.json)
set -euo pipefail
cd "$(dirname "$0")/.."
build=${1:?usage: tests/lint.sh BUILD_DIR}

echo "== clang-format"
git ls-files '*.cpp' '*.hpp' | xargs clang-format-19 --dry-run --Werror

echo "== clang-tidy, of the files that this build compiles"
# A library of another version has a file of its own (hal/gpio/gpiod_v2.cpp): not built here, so not readable either.
built=()
while read -r file; do
  if grep -qF "/$file\"" "$build/compile_commands.json"; then built+=("$file"); else echo "not built here: $file"; fi
done < <(git ls-files 'app/*.cpp' 'config/*.cpp' 'hal/*.cpp' 'model/*.cpp' 'tests/*.cpp')
[ ${#built[@]} -gt 0 ] || { echo "error: $build/compile_commands.json names no file of this checkout" >&2; exit 2; }
printf '%s\n' "${built[@]}" | xargs -P "$(nproc)" -n 4 clang-tidy-19 -p "$build" --quiet
