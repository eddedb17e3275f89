#!/usr/bin/env bash
# clang-format and clang-tidy over every source file; any finding is an error.
#   tests/lint.sh BUILD_DIR      (a configured build with compile_commands.json)
set -euo pipefail
cd "$(dirname "$0")/.."
build=${1:?usage: tests/lint.sh BUILD_DIR}

echo "== clang-format"
git ls-files '*.cpp' '*.hpp' | xargs clang-format-19 --dry-run --Werror

echo "== clang-tidy"
git ls-files 'app/*.cpp' 'config/*.cpp' 'hal/*.cpp' 'model/*.cpp' 'tests/*.cpp' |
  xargs -P "$(nproc)" -n 4 clang-tidy-19 -p "$build" --quiet
