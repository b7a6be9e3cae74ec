"""Validation: the numbers of the paper beside those of the model, as a page of the documents."""
