"""Report of a bag as one HTML page, made in one pass and in bounded memory."""
