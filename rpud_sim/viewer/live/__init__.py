"""A running drill: what was heard of it, and actions on it."""
