"""What can go wrong with a bag. Every message is one line that names the file or the value."""


class BagError(Exception):
    """A bag cannot be read or written.

    What is no printable character in the text, such as those of names in a bag, is escaped.
    """

    def __init__(self, text: str = "") -> None:
        super().__init__(
            "".join(
                each if each.isprintable() else ascii(each)[1:-1]  # as in Python: \n, \x1b
                for each in text
            )
        )


class BagExistsError(BagError):
    """A bag would be written where something exists already."""


class BagNotFoundError(BagError):
    """There is no bag at the path."""


class BagFormatError(BagError):
    """The bytes at the path are not a complete MCAP bag."""


class DefinitionNotFoundError(BagError):
    """The definition of a message type is not on the search path."""
