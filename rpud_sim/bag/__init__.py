"""MCAP bags as rosbag2 understands them: writer, reader and recovery."""
