"""Pages of the package: frame, style, and plots that a reader can zoom."""
