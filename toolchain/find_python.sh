#!/bin/sh
# Prints the Python to build with, or one line that says what is missing. $PYTHON and $ROS_PREFIX narrow the choice.

fail() {
  echo "rpud_sim: $1" >&2
  exit 1
}

case "$PWD" in
  *[[:space:]:\;\"\'\\\$\#]*) fail "CMake and Python's environments cannot build in '$PWD': move the clone to a path without spaces and : ; \" ' \\ \$ #" ;;
esac
machine="$(uname -s) $(uname -m)"
[ "$machine" = "Linux x86_64" ] || fail "needs Linux on x86-64, this is $machine"
command -v "${CXX:-c++}" >/dev/null || fail "needs a C++ compiler: sudo apt install g++"

# An installed Jazzy is compiled for one Python.
if [ -n "${ROS_PREFIX:-}" ]; then
  candidates="${PYTHON:-/usr/bin/python3.12 python3.12}"
  versions="(3, 12)"
  wanted="CPython 3.12, as $ROS_PREFIX does"
else
  candidates="${PYTHON:-python3 python3.12 python3.11 python3.13 python3.10}"
  versions="(3, 10), (3, 11), (3, 12), (3, 13)"
  wanted="CPython 3.10 to 3.13"
fi

# Inside .venv itself `python3` is the one that set-up replaces, so print the one that it was made from.
probe="
import importlib.util, os, sys, sysconfig
name = 'python%d.%d' % sys.version_info[:2]
print(sys.executable if sys.prefix == sys.base_prefix else os.path.join(sys.base_prefix, 'bin', name))
if sys.implementation.name != 'cpython' or sys.version_info[:2] not in ($versions,):
    sys.exit(10)
header = os.path.join(sysconfig.get_path('include'), 'Python.h')
if not os.path.exists(header) or not importlib.util.find_spec('ensurepip'):
    sys.exit(20)
"
incomplete=
for candidate in $candidates; do
  path="$("$candidate" -c "$probe" 2>/dev/null)"
  case $? in
    0) echo "$path"; exit ;;
    20) incomplete="${incomplete:-$candidate}" ;;
  esac
done
[ -z "$incomplete" ] || fail "$incomplete has no headers or no venv module: sudo apt install python3-dev python3-venv"
fail "needs $wanted, and none of these is one: $candidates"
