"""What a bag holds as one page: it is gone through once, and memory does not grow with it."""
