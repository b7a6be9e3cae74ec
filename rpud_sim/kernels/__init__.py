"""Kernels: how the model is compiled, stored in files, and found again by another process."""
