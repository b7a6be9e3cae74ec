"""Whole state of a run as JSON, from which a run goes on with the same bits.

Numbers are exact and arrays are base64. A state may come from a stranger's bag: reading it makes
only immutable values of this package, and objects that a new run of the same beginning has too.
"""

from __future__ import annotations

import base64
import dataclasses
import sys
from array import array
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from rpud_sim.drilling.rock import Strata
from rpud_sim.foundation.quantities import ParameterGroup
from rpud_sim.model.drill import STATE, DrillConstants
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.segment import IMPACT, SEGMENT
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.fault_kinds import Stage

_DTYPES: Mapping[str, np.dtype[Any]] = {
    "state": STATE,
    "segment": SEGMENT,
    "impact": IMPACT,
    "float64": np.dtype(np.float64),
    "int64": np.dtype(np.int64),
    "bool": np.dtype(np.bool_),
}
# The same without padding, which holds whatever was in memory.
_PACKED = {
    name: np.dtype([(field, dtype[field]) for field in dtype.names]) if dtype.names else dtype
    for name, dtype in _DTYPES.items()
}
# Attributes that are no state: what a run gets from its owner or its beginning, room for results,
# and what is kept so that it need not be calculated again. What commands do is in the simulation.
_LEFT_OUT = frozenset(
    (
        *("beginning", "control", "_journal", "_wanted", "_on_block", "_recent_energy"),
        *("coupling_power",),
        *("_published_faults", "_refusals", "_parameters"),
        *("_telemetry_rate", "_sample_rate", "_stream_period"),
        *("_goal", "_segment_room", "_impact_room", "_written"),
        *("_given", "_struck", "_advance_code", "_interrupt_code"),
    )
)
_SEQUENCES: Mapping[str, type[Any]] = {"tuple": tuple, "list": list, "deque": deque}
_TYPES = {"float": float, "int": int, "bool": bool, "str": str}


def write_state(value: Any, seen: set[int] | None = None) -> Any:
    """Return an object and all that it holds as values for JSON, each object once."""
    seen = set() if seen is None else seen  # objects that are written already
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        name = next(name for name, dtype in _DTYPES.items() if dtype == value.dtype)
        return {"array": name, "bytes": _text(value.astype(_PACKED[name]).tobytes())}
    if isinstance(value, array):
        return {"doubles": _text(value.tobytes())}
    if isinstance(value, np.random.Generator):
        return {"random": value.bit_generator.state}
    if isinstance(value, dict):
        return {"dict": [[write_state(key, seen), write_state(value[key], seen)] for key in value]}
    if callable(value):  # a message that is made when a fault needs it
        return write_state(value(), seen)
    if _is_value(type(value)):
        held = [write_state(getattr(value, name), seen) for name in _fields(type(value))]
        return {"value": _name(value), "of": held}
    if isinstance(value, (tuple, list, deque)):
        return {type(value).__name__: [write_state(each, seen) for each in value]}
    if id(value) in seen:
        return None
    seen.add(id(value))
    attributes = {
        name: write_state(each, seen)
        for name, each in vars(value).items()
        if name not in _LEFT_OUT and not _is_fixed(each) and id(each) not in seen
    }
    return {"object": _name(value), "of": attributes}


def read_state(old: Any, tree: Any, configuration: Configuration) -> Any:
    """Return the value of a tree; an object is set in place of the old one of its class."""

    def read(old: Any, tree: Any) -> Any:
        if not isinstance(tree, dict):
            return tree
        kind = next(iter(tree), "")
        content: Any = tree.get(kind)
        if kind == "array":
            packed = np.frombuffer(_data(tree["bytes"]), _PACKED[content])
            # Zeros, for the conversion leaves out the bytes between two fields.
            values = np.zeros(len(packed), _DTYPES[content])
            for field in values.dtype.names or ():
                values[field] = packed[field]
            return values if values.dtype.names else packed.copy()
        if kind == "doubles":
            return array("d", _data(content))
        if kind == "random":
            random = np.random.default_rng()
            random.bit_generator.state = content
            return random
        if kind == "dict":
            return {read(None, key): read(None, each) for key, each in content}
        if kind in _SEQUENCES:
            return _SEQUENCES[kind](read(None, each) for each in content)
        if kind == "value":
            return _new_value(content, [read(None, each) for each in tree["of"]])
        if kind == "object":
            return read_object(old, content, tree["of"])
        raise ValueError(f"{kind:.80} is no kind of a state's values")

    def read_object(old: Any, name: str, trees: Mapping[str, Any]) -> Any:
        if name == f"{Stage.__module__}.{Stage.__name__}":
            old = Stage("", 0.0, np.random.default_rng(0), None)
        if old is None or _name(old) != name:
            raise ValueError(f"{name:.80} does not belong to the state")
        held = vars(old)
        for attribute, tree in trees.items():
            if attribute not in held or attribute in _LEFT_OUT or _is_fixed(held[attribute]):
                raise ValueError(f"{name} has no state {attribute:.40}")
            before, value = held[attribute], read(held[attribute], tree)
            _check(attribute, before, value)
            if isinstance(before, deque):  # of its length
                before.clear()
                before.extend(value)
            else:
                setattr(old, attribute, value)
        if "configuration" in held:
            old.configuration = configuration
        return old

    return read(old, tree)


def _new_value(name: str, values: list[Any]) -> Any:
    """Return an immutable value of this package, whose numbers and texts have their types."""
    module, _, own = name.rpartition(".")
    found: Any = getattr(sys.modules.get(module), own, None)
    if not (module.startswith("rpud_sim.") and isinstance(found, type) and _is_value(found)):
        raise ValueError(f"{name:.80} is no value of a state")
    for (field, hint), value in zip(_fields(found).items(), values, strict=True):
        wanted = hint if isinstance(hint, type) else _TYPES.get(str(hint))
        if wanted is not None and type(value) is not wanted:
            raise ValueError(f"{name}.{field} = {value!r:.40} is no {wanted.__name__}")
    made = found(*values)
    if isinstance(made, Block):
        _check_records("covering", [made.covering], SEGMENT)
        _check_records("impacts", [made.impacts], IMPACT)
        _check_records("ends", (made.ends, made.finished, made.struck), _DTYPES["int64"])
        counts = (1, len(made.covering) - 1, len(made.impacts))
        if counts[1] < 0 or (len(made), *made.finished, *made.struck) != counts:
            raise ValueError("a block has other segments or impacts than it counts")
    return made


def _check(name: str, before: Any, value: Any) -> None:
    """Check the type of an attribute: compiled code takes no other, and does not look."""
    if isinstance(before, (bool, int, float, str, tuple, list, deque, array, dict)):
        if type(value) is not type(before):
            raise ValueError(f"{name} = {value!r:.40} is no {type(before).__name__}")
    elif isinstance(before, np.ndarray):
        if not isinstance(value, np.ndarray) or value.dtype != before.dtype:
            raise ValueError(f"{name} is no array of {before.dtype!s:.40}")
        if before.dtype.names and value.shape != before.shape:
            raise ValueError(f"{name} has the shape {value.shape}, not {before.shape}")
    elif hasattr(before, "__dict__") and not _is_value(type(before)) and value is not before:
        raise ValueError(f"{name} is no {type(before).__name__}")
    # Records that wait for the next block.
    if name in ("_segments", "_impacts") and isinstance(value, list):
        _check_records(name, value, SEGMENT if name == "_segments" else IMPACT)
    if name == "_seating" and not all(map(_is_seating, value)):
        raise ValueError("_seating holds other values than times and drills")


def _is_seating(step: Any) -> bool:
    if not (type(step) is tuple and len(step) == 2 and type(step[0]) is tuple):
        return False
    return tuple(map(type, step[0])) == (int, float) and type(step[1]) is DrillConstants


def _check_records(name: str, arrays: Any, dtype: np.dtype[Any]) -> None:
    if not all(isinstance(each, np.ndarray) and each.dtype == dtype for each in arrays):
        raise ValueError(f"{name} holds other arrays than {dtype.names and dtype.names[0]}")


def _is_fixed(value: Any) -> bool:
    """Return whether a value follows from the beginning of the run, or is set with it."""
    fixed = (ParameterGroup, Strata, Configuration)
    return isinstance(value, fixed) and not isinstance(value, Parameters)


def _is_value(kind: type) -> bool:
    """Return whether instances of a class are immutable and hold only their fields."""
    if issubclass(kind, tuple):
        return hasattr(kind, "_fields")
    if not dataclasses.is_dataclass(kind) or issubclass(kind, (Strata, Configuration)):
        return False
    frozen = kind.__dataclass_params__.frozen  # type: ignore[attr-defined]
    return frozen and (kind is Parameters or not issubclass(kind, ParameterGroup))


def _fields(kind: Any) -> dict[str, Any]:
    """Return the fields of a value, with their types or the texts of these."""
    if issubclass(kind, tuple):
        hints = {name: kind.__annotations__[name] for name in kind._fields}
    else:
        hints = {field.name: field.type for field in dataclasses.fields(kind)}
    return {name: getattr(hint, "__forward_arg__", hint) for name, hint in hints.items()}


def _name(value: Any) -> str:
    return f"{type(value).__module__}.{type(value).__name__}"


def _text(data: bytes) -> str:
    return base64.b64encode(data).decode()


def _data(text: str) -> bytes:
    return base64.b64decode(text, validate=True)
