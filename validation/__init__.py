"""Validation: numbers of the paper beside the model's, as a page of the documents."""
