"""The drill as a managed node: paced, commanded, telling what it does."""
