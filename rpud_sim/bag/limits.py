"""Limits of what is read from a bag, so that a few bytes cannot take all memory."""

RECORD_LIMIT = 128 * 2**20  # greatest record, uncompressed chunk, and document [bytes]
TOPICS_LIMIT = 10_000  # greatest number of channels of a file, and of schemas
OVERLAP_LIMIT = 256 * 2**20  # greatest size of the chunks that overlap in time [bytes]
