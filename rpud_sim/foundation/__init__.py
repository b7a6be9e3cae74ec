"""Foundation of all packages: quantities and their checks, parameters, time, files, terminal."""
