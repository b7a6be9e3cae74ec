"""What every room stands on: quantities and their checks, parameters, time, and YAML."""
