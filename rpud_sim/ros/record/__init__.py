"""The recorder: topics of a running system into a bag."""
