#!/bin/bash
# Prints how long each stage takes from a fresh clone to the first impact. Works in a temporary folder.
set -euo pipefail
cd "$(dirname "$0")/.."

folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
export XDG_CACHE_HOME="$folder/cache" # no kernels of this user
PIP_CACHE_DIR="$(.venv/bin/python -m pip cache dir 2>/dev/null || echo "$HOME/.cache/pip")"
UV_CACHE_DIR="${UV_CACHE_DIR:-$HOME/.cache/uv}"
export PIP_CACHE_DIR UV_CACHE_DIR # but the downloads, whose time is the network's

unset MAKEFLAGS MFLAGS MAKELEVEL # of the make that has started this: the one below has jobs of its own

begin="$(date +%s.%N)"
last="$begin"
stage() { # NAME: prints the time since the last stage, and since the beginning
  local now
  now="$(date +%s.%N)"
  awk -v n="$1" -v a="$last" -v b="$now" -v c="$begin" 'BEGIN { printf "%-34s %6.1f s %8.1f s\n", n, b - a, b - c }'
  last="$now"
}

printf "%-34s %8s %10s\n" stage took total
git clone --quiet . "$folder/clone"
cd "$folder/clone"
stage "clone"
make --silent .venv/.installed
stage "wheels"
make --silent install/.messages install/.kernels
stage "messages, and kernels beside them"
make --silent setup >/dev/null
stage "package"
source ./env.bash
rpud simulate --duration 0.1 >/dev/null
stage "rpud simulate --duration 0.1"
rpud run --duration 0.1 >/dev/null
stage "rpud run --duration 0.1"
