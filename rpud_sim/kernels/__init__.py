"""Kernels: how the model is compiled, kept in files, and found again by another process."""
