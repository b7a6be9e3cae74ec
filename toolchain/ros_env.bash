# Sourced by env.bash and, at the root, by make, in any sh: the virtual environment and ROS 2 Jazzy, without this package. For users: env.bash.

_rpud_prepend() { # NAME FOLDER...: puts the folders in front of the search path NAME, each only once
  local name="$1" folder value
  shift
  for folder in "$@"; do
    eval "value=\${$name:-}"
    case ":$value:" in
      *":$folder:"*) ;;
      *) export "$name=$folder${value:+:$value}" ;;
    esac
  done
}

_rpud_source() { # SETUP: sources SETUP.bash, .zsh or .sh without `set -u` and `set -e`, which ROS's own scripts do not survive
  local options="$-" code=0 shell=sh
  if [ -n "${BASH_VERSION:-}" ]; then shell=bash; elif [ -n "${ZSH_VERSION:-}" ]; then shell=zsh; fi
  set +eu
  . "$1.$shell" || code=$?
  case "$options" in *u*) set -u ;; esac
  case "$options" in *e*) set -e ;; esac
  return "$code"
}

_rpud_ros_env() {
  local toolchain venv profile
  toolchain="${_rpud_root:-$PWD}/toolchain" # env.bash sets the root; make runs there
  venv="${_rpud_root:-$PWD}/.venv"

  if [ -d "$venv/share/rclpy" ]; then # ROS as wheels
    _rpud_prepend AMENT_PREFIX_PATH "$venv"
    _rpud_prepend CMAKE_PREFIX_PATH "$venv"
    export CMAKE_TOOLCHAIN_FILE="$toolchain/wheels.cmake"
    # Python processes would restart themselves to set this; programs in C++ have nobody to do it for them.
    _rpud_prepend LD_LIBRARY_PATH "$venv/lib" "$venv"/lib/python3.*/site-packages/ros_*.libs
    export _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
  elif [ -f "$venv/ros_prefix" ]; then # an installed ROS
    _rpud_source "$(cat "$venv/ros_prefix")/setup"
  else
    echo "rpud_sim: not set up yet: run 'make setup' first" >&2
    return 1
  fi

  export VIRTUAL_ENV="$venv"
  unset PYTHONHOME
  # It is set in many containers. Each start would compile all imported modules again, which takes seconds.
  unset PYTHONDONTWRITEBYTECODE
  _rpud_prepend PATH "$venv/bin"

  export ROS_DOMAIN_ID="${ROS_DOMAIN_ID:-42}"
  # Only processes of this machine may reach a drill on the desk. The range LOCALHOST still opens sockets on every
  # interface, and does so beside a profile too; SYSTEM_DEFAULT leaves discovery to the profile.
  export ROS_AUTOMATIC_DISCOVERY_RANGE="${ROS_AUTOMATIC_DISCOVERY_RANGE:-LOCALHOST}"
  profile="$(dirname "$toolchain")/config/fastdds_loopback.xml"
  case "$ROS_AUTOMATIC_DISCOVERY_RANGE ${RMW_IMPLEMENTATION:-rmw_fastrtps_cpp} ${FASTRTPS_DEFAULT_PROFILES_FILE:-$profile}" in
    "LOCALHOST rmw_fastrtps"*" $profile")
      export FASTRTPS_DEFAULT_PROFILES_FILE="$profile"
      export ROS_AUTOMATIC_DISCOVERY_RANGE=SYSTEM_DEFAULT
      ;;
  esac
}

_rpud_ros_env
