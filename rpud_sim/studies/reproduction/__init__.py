"""Reproduction of the paper: every figure and number, with intervals, under every reading."""
