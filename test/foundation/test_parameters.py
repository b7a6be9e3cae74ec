"""A parameter is declared by one field; checks, names and ranges follow from it."""

import dataclasses

import pytest

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
from rpud_sim.foundation.quantities import Choice, Flag, ParameterError, Quantity, Text


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
    assert dict(declarations(Pump)) == {
        "flow": Declaration(
            "flow", 2.0, Quantity("l/s", "flow of the pump", 0.0, 9.0, exclusive=True), True
        ),
        "strokes": Declaration(
            "strokes", 3, Quantity("", "strokes in a row", 1.0, 5.0, whole=True), False
        ),
        "mode": Declaration("mode", "idle", Choice("mode of the pump", ("idle", "full")), True),
        "reverse": Declaration("reverse", False, Flag("whether it turns back"), False),
        "log": Declaration("log", "", Text("file of its log", "a path"), False),
    }


def test_declarations_come_in_order_and_do_not_change():
    assert list(declarations(Pump)) == ["flow", "strokes", "mode", "reverse", "log"]
    with pytest.raises(TypeError):
        declarations(Pump)["flow"] = None


def test_the_quantities_are_the_numbers_alone():
    assert list(quantities(Pump)) == ["flow", "strokes"]
    assert quantities(Pump)["flow"].range == "(0, 9] l/s"


def test_defaults_hold_and_values_are_kept_in_their_types():
    assert Pump() == Pump(2.0, 3, "idle", False, "")
    pump = Pump(flow=4, strokes=2.0)
    assert (type(pump.flow), type(pump.strokes)) == (float, int)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"flow": 0}, "flow = 0 l/s is outside its range (0, 9] l/s"),
        ({"strokes": 1.5}, "strokes = 1.5 is not a whole number"),
        ({"mode": "fast"}, "mode = 'fast' is not one of idle, full"),
        ({"reverse": 1}, "reverse = 1 is not true or false"),
        ({"log": None}, "log = None is not a text"),
    ],
)
def test_a_value_that_is_not_allowed_is_refused_by_name(values, complaint):
    with pytest.raises(ParameterError) as caught:
        Pump(**values)
    assert str(caught.value) == complaint
    with pytest.raises(ParameterError):
        dataclasses.replace(Pump(), **values)
