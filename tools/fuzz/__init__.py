"""Hostile inputs to every way into the drill."""
