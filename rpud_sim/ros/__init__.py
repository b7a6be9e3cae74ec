"""The ROS 2 face: node, parameters, conversions, recorder and replayer."""

import os

from rpud_sim.ros.environment import complete_environment

# Here, because whoever starts ROS has imported this package before.
complete_environment(os.environ)
