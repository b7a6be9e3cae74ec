"""The ROS 2 face: drill, recorder, replayer, and a client of running drills."""
