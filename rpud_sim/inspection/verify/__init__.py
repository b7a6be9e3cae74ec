"""Proof that a bag holds what the simulation computes: its journal is run again, bit for bit."""
