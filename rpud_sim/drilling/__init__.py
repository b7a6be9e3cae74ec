"""Processes around the percussion that are slow: rotation, feed and mount, borehole and rock."""
