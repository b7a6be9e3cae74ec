# Source this in bash, zsh, dash or another sh: puts rpud, drill_node, recorder, replayer and ROS 2 Jazzy into the shell.
# It keeps a ROS_DOMAIN_ID and a FASTRTPS_DEFAULT_PROFILES_FILE that are set already, and any
# ROS_AUTOMATIC_DISCOVERY_RANGE but LOCALHOST: docs/security.md says which sockets a process opens.

_rpud_env() {
  local file where= before="${ROS_DOMAIN_ID:-} ${ROS_AUTOMATIC_DISCOVERY_RANGE:-}"
  # Only bash and zsh know which file they source; each has a notation that other shells do not parse.
  if [ -n "${BASH_VERSION:-}" ]; then
    eval 'file="${BASH_SOURCE[0]}"'
  elif [ -n "${ZSH_VERSION:-}" ]; then
    eval 'file="${(%):-%x}"'
  else
    file=./env.bash
  fi
  _rpud_root="$(cd "$(dirname "$file")" && pwd)"
  if [ ! -f "$_rpud_root/toolchain/ros_env.bash" ]; then
    echo "rpud_sim: this shell does not know where env.bash is: source it as ./env.bash in its own folder" >&2
    return 1
  fi

  . "$_rpud_root/toolchain/ros_env.bash" || return 1
  if [ ! -f "$_rpud_root/install/local_setup.bash" ]; then
    echo "rpud_sim: not built yet: run 'make setup' first" >&2
    return 1
  fi
  _rpud_source "$_rpud_root/install/local_setup" || return 1
  _rpud_prepend PATH "$_rpud_root/install/rpud_sim/lib/rpud_sim"
  # A Foxglove in another terminal would see nothing, and not say why.
  if [ -t 2 ] && [ "$before" != "$ROS_DOMAIN_ID $ROS_AUTOMATIC_DISCOVERY_RANGE" ]; then
    case "$ROS_AUTOMATIC_DISCOVERY_RANGE" in
      SYSTEM_DEFAULT | LOCALHOST) where=", on this machine only" ;;
    esac
    echo "rpud_sim: ROS_DOMAIN_ID is $ROS_DOMAIN_ID$where: source env.bash in every terminal that shall see the drill" >&2
  fi
}

_rpud_env
