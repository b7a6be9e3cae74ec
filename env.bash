# Source this in bash or zsh: puts rpud, drill_node, recorder, replayer and ROS 2 Jazzy into the shell.
# It keeps a ROS_DOMAIN_ID and a FASTRTPS_DEFAULT_PROFILES_FILE that are set already, and any
# ROS_AUTOMATIC_DISCOVERY_RANGE but LOCALHOST: docs/security.md says which sockets a process opens.

_rpud_env() {
  local shell=bash file root
  if [ -n "${ZSH_VERSION:-}" ]; then shell=zsh; fi
  file="${BASH_SOURCE[0]:-${(%):-%x}}"
  root="$(cd "$(dirname "$file")" && pwd)"

  . "$root/toolchain/ros_env.bash" || return 1
  if [ ! -f "$root/install/local_setup.$shell" ]; then
    echo "rpud_sim: not built yet: run 'make setup' first" >&2
    return 1
  fi
  _rpud_source "$root/install/local_setup.$shell" || return 1
  _rpud_prepend PATH "$root/install/rpud_sim/lib/rpud_sim"
}

_rpud_env
