#!/bin/bash
# Runs every check, so that one run shows all that is wrong. Needs the environment of env.bash.
cd "$(dirname "$0")/.."

failed=()
check() {
  echo "--- $*"
  "$@" || failed+=("$1 ${2:-}")
}
check ruff check
check ruff format --check
check mypy
check lint-imports --no-logo
check python -m toolchain.check_repository
# The code of the screen. Its checker comes from npm, which CI has.
tsc=.venv/typescript/node_modules/.bin/tsc
if [ -x $tsc ] || [ -n "${CI:-}" ] || [ "${RPUD_BROWSER:-}" = required ]; then
  check $tsc --project toolchain/typescript
else
  echo "--- tsc: npm is missing: the page's code is not type-checked"
fi

if [ ${#failed[@]} -gt 0 ]; then
  echo "lint: failed:$(printf ' %s,' "${failed[@]}" | sed 's/,$//')" >&2
  exit 1
fi
echo "lint: all checks passed"
