"""Studies of many runs: sweeps, data sets, sensitivity and fits."""
