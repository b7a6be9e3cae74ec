"""A parameter is declared by one field; checks, names and ranges follow from it."""

import dataclasses

import pytest
from support import refusal

from rpud_sim.foundation.parameters import (
    Declaration,
    ParameterGroup,
    choice,
    declarations,
    flag,
    number,
    quantities,
    text,
)
from rpud_sim.foundation.quantities import Choice, Flag, Quantity, Text


@dataclasses.dataclass(frozen=True)
class Pump(ParameterGroup):
    """A group with a parameter of each kind, and a field that declares none."""

    flow: float = number(2.0, "l/s", "flow of the pump", 0.0, 9.0, exclusive=True, changeable=True)
    strokes: int = number(3, "", "strokes in a row", 1.0, 5.0, whole=True)
    mode: str = choice("idle", ("idle", "full"), "mode of the pump", changeable=True)
    reverse: bool = flag(False, "whether it turns back")
    log: str = text("", "a path", "file of its log")
    parts: tuple[str, ...] = ()


def test_a_declaration_says_everything_of_its_parameter():
    flow = Quantity("l/s", "flow of the pump", 0.0, 9.0, exclusive=True)
    assert list(declarations(Pump).values()) == [
        Declaration("flow", 2.0, flow, True),
        Declaration("strokes", 3, Quantity("", "strokes in a row", 1.0, 5.0, whole=True), False),
        Declaration("mode", "idle", Choice("mode of the pump", ("idle", "full")), True),
        Declaration("reverse", False, Flag("whether it turns back"), False),
        Declaration("log", "", Text("file of its log", "a path"), False),
    ]
    assert list(declarations(Pump)) == ["flow", "strokes", "mode", "reverse", "log"]
    assert list(quantities(Pump)) == ["flow", "strokes"]
    with pytest.raises(TypeError):
        declarations(Pump)["flow"] = None


def test_values_are_kept_in_their_types_or_refused_by_name():
    pump = Pump(flow=4, strokes=2.0)
    assert (type(pump.flow), type(pump.strokes)) == (float, int)
    complaint = "flow = 0 l/s is outside its range (0, 9] l/s"
    assert refusal(Pump, 0) == complaint
    assert refusal(lambda: dataclasses.replace(pump, flow=0)) == complaint
