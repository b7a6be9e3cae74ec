"""Parse each message definition once for all of ROS's generators.

Each generator is a separate process and parses all definitions with a slow parser: without this,
two fifths of the processor time in which the messages are built. Python imports this file where
the folder is in PYTHONPATH, as while `make` builds the messages.
"""

import hashlib
import os
import pickle
import sys
from pathlib import Path

PARSED = Path(__file__).parents[2] / "build" / "parsed"  # a file for each definition

if any("rosidl" in each for each in sys.orig_argv):
    from rosidl_parser import parser

    parse = parser.get_ast_from_idl_string

    def parse_once(definition: str) -> object:
        """Return the syntax tree of a definition, from a file if a process has parsed it."""
        file = PARSED / hashlib.sha256(definition.encode()).hexdigest()
        if file.exists():
            return pickle.loads(file.read_bytes())
        tree = parse(definition)
        PARSED.mkdir(parents=True, exist_ok=True)
        written = file.with_suffix(f".{os.getpid()}")  # others may read meanwhile
        written.write_bytes(pickle.dumps(tree))
        written.replace(file)
        return tree

    parser.get_ast_from_idl_string = parse_once
