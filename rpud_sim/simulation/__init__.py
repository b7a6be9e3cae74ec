"""The model under commands: schedule, trajectory, sampling and statistics."""
