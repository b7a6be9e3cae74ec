"""The proof that a bag is what the simulation gives: run again from its journal, bit for bit."""
