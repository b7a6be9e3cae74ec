"""Tools that take hours, and that no package installs."""

# Environment of processes that talk on this machine alone.
LOOPBACK = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
