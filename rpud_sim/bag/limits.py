"""Limits of what is read from a bag, so that a few bytes cannot take all memory."""

RECORD_LIMIT = 128 * 2**20  # greatest record, uncompressed chunk, and document [bytes]
TOPICS_LIMIT = 10_000  # greatest number of channels of a file, and of schemas
FIELDS_LIMIT = 100_000  # greatest number of fields of a type, with those of its members
DECODED_LIMIT = 256 * 2**20  # greatest decoded message, with its text in exported files [bytes]
OVERLAP_LIMIT = 256 * 2**20  # greatest size of the chunks that overlap in time [bytes]
