"""Numbers, plots and reports from trajectories and bags."""
