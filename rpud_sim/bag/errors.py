"""What can go wrong with a bag. Every message is one line that names the file or the value."""


class BagError(Exception):
    """A bag cannot be read or written."""


class BagExistsError(BagError):
    """A bag would be written where something exists already."""


class BagNotFoundError(BagError):
    """There is no bag at the path."""


class BagFormatError(BagError):
    """The bytes at the path are not a complete MCAP bag."""


class DefinitionNotFoundError(BagError):
    """The definition of a message type is not on the search path."""
