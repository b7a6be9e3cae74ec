"""Studies of many runs: the reproduction of the paper, and sweeps over parameters."""
