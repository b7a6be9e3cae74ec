"""Messages without ROS: batches of them, their types, and the codec between fields and bytes."""
