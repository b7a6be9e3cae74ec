"""The ROS 2 face: node, parameters, conversions, recorder and replayer."""
