"""The paper's impact dynamics: bodies, collisions, and the engine that finds the next impact."""
