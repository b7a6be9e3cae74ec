"""Impact dynamics of the paper: bodies, collisions, and the engine that finds the next impact."""
