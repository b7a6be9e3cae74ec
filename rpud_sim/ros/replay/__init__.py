"""The replayer: a bag as topics again, in its time."""
