#!/bin/bash
# try_wheels.sh PYTHON WHEELS: installs the wheels of a folder into a new environment that has sourced nothing; drills, records and
# verifies there; prints the times and the disk space.
set -euo pipefail
python="$1" wheels="$(realpath "$2")"
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for name in AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH VIRTUAL_ENV \
  FASTRTPS_DEFAULT_PROFILES_FILE RMW_IMPLEMENTATION ROS_AUTOMATIC_DISCOVERY_RANGE ROS_PACKAGE_PATH; do
  unset "$name"
done
TIMEFORMAT='%1R s, %1U s of processors'
step() {
  echo "$*"
  time "$@" >/dev/null
}
step "$python" -m venv v
step v/bin/pip install --quiet --disable-pip-version-check --find-links "$wheels" 'rpud_sim[ros,test]'
du --summarize --si v
step v/bin/rpud simulate --duration 0.1
step v/bin/rpud run --duration 1 --record bag --quiet --namespace "/try_$$" # another drill may run on this machine
step v/bin/rpud verify bag
