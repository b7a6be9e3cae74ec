"""Files of expectations: what is refused, in one line with its place, and what is understood."""

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.yaml_files import yaml_node
from rpud_sim.verdicts import (
    Active,
    Becomes,
    Cleared,
    Expectation,
    Onset,
    Published,
    after,
    always,
    count,
    eventually,
    quantile,
    read_expectations,
    signal,
    unless,
    until,
)
from rpud_sim.verdicts.notation import to_formula, to_plain, to_text

FORCE = signal("reacting_force.force")
WEIGHT = signal("status.weight_on_bit")
JAMMED = "free_mass_jammed"

UNDERSTOOD = [
    ("reacting_force.force < 45 N", FORCE < "45 N"),
    ("reacting_force.force<45N", FORCE < "45 N"),
    ("status.weight_on_bit = 0 N +- 100 mN", WEIGHT.equals("0 N", "100 mN")),
    ("status.weight_on_bit != 0", WEIGHT.compare("!=", 0)),
    ("status.state is running", signal("status.state").has_text("running")),
    ("drill_tool.in_contact is true", signal("drill_tool.in_contact").has_text(True)),
    ("status.actuator_temperature < 60 degC", signal("status.actuator_temperature") < "60 degC"),
    ("command/weight_on_bit.force >= 1e-3 kN", signal("command/weight_on_bit.force") >= "1e-3 kN"),
    ("joint_states.position[1] < 3 mm", signal("joint_states.position[1]") < "3 mm"),
    ({"fault": JAMMED}, Active(JAMMED)),
    ({"not": {"fault": "noise on wrench"}}, ~Active("noise on wrench")),
    ({"onset": JAMMED}, Onset(JAMMED)),
    (
        {"message": "journal", "where": "journal.kind is inject"},
        Published("journal", signal("journal.kind").has_text("inject")),
    ),
    ({"always": "reacting_force.force < 45 N"}, always(FORCE < "45 N")),
    (
        {"eventually": "reacting_force.force < 45 N", "between": ["1 s", "end"]},
        eventually(FORCE < "45 N", between=("1 s", None)),
    ),
    (
        {"hold": "status.weight_on_bit == 0", "unless": {"cleared": JAMMED}},
        unless(WEIGHT.equals(0), Cleared(JAMMED)),
    ),
    (
        {"hold": "status.weight_on_bit == 0", "until": {"cleared": JAMMED}, "within": "2 s"},
        until(WEIGHT.equals(0), Cleared(JAMMED), within="2 s"),
    ),
    (
        {"after": {"becomes": "reacting_force.force > 40 N"}, "expect": "status.impacts > 3"},
        after(Becomes(FORCE > "40 N"), signal("status.impacts") > 3),
    ),
    (
        {"if": "reacting_force.force > 40 N", "then": {"fault": JAMMED}},
        (FORCE > "40 N").implies(Active(JAMMED)),
    ),
    (
        {"any": ["reacting_force.force > 40 N", {"fault": JAMMED}]},
        (FORCE > "40 N") | Active(JAMMED),
    ),
    (
        {"all": ["reacting_force.force > 40 N", {"fault": JAMMED}]},
        (FORCE > "40 N") & Active(JAMMED),
    ),
    (
        {"count": {"message": "contact_force"}, "is": ">= 10", "within": "1 s"},
        count(Published("contact_force"), ">=", 10, within=1.0),
    ),
    (
        {"quantile": 0.99, "of": "contact_force.peak_force", "is": "< 9 kN"},
        quantile(0.99, signal("contact_force.peak_force"), "<", "9 kN"),
    ),
]


@pytest.mark.parametrize(("plain", "formula"), UNDERSTOOD, ids=lambda each: str(each)[:40])
def test_a_form_is_understood_and_written_again(plain, formula):
    for each in (plain, to_plain(formula)):
        assert to_formula(yaml_node(each, "test")) == formula
    Expectation("it", formula)


@pytest.mark.parametrize(
    ("formula", "text"),
    [
        (always(FORCE < "450 N"), "always(reacting_force.force < 450 N)"),
        (
            after(Onset(JAMMED), eventually(WEIGHT.equals("0 N", "1 N"), within="0.5 s")),
            "after(onset(free_mass_jammed), "
            "expect eventually(status.weight_on_bit == 0 N +- 1 N, within 0.5 s))",
        ),
        (
            until(~Active(JAMMED), FORCE > "40 N", between=("1 s", None)),
            "hold(not(fault(free_mass_jammed)), "
            "until reacting_force.force > 40 N, between 1 s and end)",
        ),
        (
            (FORCE > "40 N").implies((FORCE < "50 N") | Active(JAMMED)),
            "if(reacting_force.force > 40 N, "
            "then any(reacting_force.force < 50 N, fault(free_mass_jammed)))",
        ),
        (
            count(Published("contact_force"), ">=", 10, within="1 s"),
            "count(message(contact_force), is >= 10, within 1 s)",
        ),
        (
            quantile(0.99, signal("contact_force.peak_force"), "<", "9 kN"),
            "quantile(0.99, of contact_force.peak_force, is < 9 kN)",
        ),
    ],
)
def test_a_text_has_the_words_of_a_file(formula, text):
    assert to_text(formula) == text


REFUSED = {
    "reacting_forc.force < 45 N": "topic 'reacting_forc' is none of the drill's; "
    "did you mean reacting_force? (others begin with /)",
    "reacting_force.forc < 45 N": "reacting_force has no field 'forc'; did you mean force?",
    "reacting_force.force < 45 s": "reacting_force.force is in N, given 45 s",
    "status.actuator_temperature < 333 K": "actuator_temperature is in degC, given 333 K",
    "reacting_force.force < 45 n": "unit 'n' is unknown; did you mean N?",
    "status.impacts < 45 N": "status.impacts is a number without a unit, given 45 N",
    "reacting_force.force < .inf N": "is not a comparison of reacting_force.force",
    "reacting_force.force is high": "reacting_force.force is a number: compare it with ==",
    "status.state == 3": "status.state is not a number: write status.state is WORD",
    "drill_tool.in_contact is maybe": "drill_tool.in_contact is true or false, given 'maybe'",
    "joint_states.position < 3 mm": "has many values; name one of them, as position[0]",
    "faults.faults < 3": "is a list of messages, not a signal; use fault, onset or cleared",
    "nonsense": "is not a comparison, as reacting_force.force < 45 N",
    "{fault: free_mass_jamed}": "did you mean free_mass_jammed?",
    "{fault: noise}": "noise needs a channel: one of",
    "{allways: status.impacts > 3}": "'allways' begins no formula; did you mean always?",
    "{always: status.impacts > 3, witin: 1 s}": "'witin' is not a key here; did you mean within?",
    "{always: status.impacts > 3, within: 3 N}": "within is in s, given 3 N",
    "{always: status.impacts > 3, between: [2 s, 1 s]}": "ends before it begins",
    "{always: status.impacts > 3, within: 1 s, between: [1 s, 2 s]}": "exclude each other",
    "{hold: status.impacts > 3}": "unless or until is missing",
    "{after: {onset: choking}}": "expect is missing",
    "{all: []}": "all and any need at least one formula",
    "{count: status.impacts > 3, is: < 3}": "count needs an event",
    "{count: {message: status}, is: < 3 N}": "a count has no unit, given 3 N",
    "{quantile: 2, of: status.impacts, is: < 3}": "quantile = 2 is outside its range (0, 1]",
    f"{{quantile: 1{'0' * 400}, of: status.impacts, is: < 3}}": "is outside its range (0, 1]",
    "{message: contact_forces}": "did you mean contact_force?",
    "{message: status, where: journal.kind is begin}": "a message of status has no journal.kind",
    "{becomes: {onset: choking}}": "an event is an instant, and becomes nothing",
}


@pytest.mark.parametrize("written", REFUSED, ids=lambda text: text[:40])
def test_a_wrong_expectation_is_refused_in_one_line_with_its_place(tmp_path, written):
    path = tmp_path / "wrong.yaml"
    good = "- {name: good, expect: status.impacts > 3}"
    path.write_text(f"expectations:\n{good}\n- name: bad\n  expect:\n    {written}\n")
    with pytest.raises(ParameterError) as caught:
        read_expectations(path)
    text = str(caught.value)
    assert "\n" not in text
    assert REFUSED[written] in text
    assert text.startswith((f"{path}:4: ", f"{path}:5: "))


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("expectations:\n- name: a", "wrong.yaml:2: expect is missing"),
        (
            "expectations:\n- name: a\n  expects: status.impacts > 3",
            "wrong.yaml:3: 'expects' is not a key here; did you mean expect?",
        ),
        ("expectations: [", "wrong.yaml is not YAML"),
        (
            "expectations:\n- {name: a, expect: status.impacts > 3}\n"
            "- {name: a, expect: status.impacts > 3}",
            "wrong.yaml:3: name 'a' is taken already",
        ),
    ],
)
def test_a_file_of_another_form_is_refused(tmp_path, content, complaint):
    path = tmp_path / "wrong.yaml"
    path.write_text(content)
    with pytest.raises(ParameterError) as caught:
        read_expectations(path)
    assert complaint in str(caught.value)


def test_a_signal_compared_as_a_value_is_no_formula():
    with pytest.raises(ParameterError, match="False is not a formula; compare by <"):
        Expectation("it", always(WEIGHT == 0))
    with pytest.raises(ParameterError, match=r"^signal\('status.weight_on_bit'\) is not a formula"):
        Expectation("it", always(WEIGHT))


def test_a_file_that_is_missing_is_named(tmp_path):
    with pytest.raises(ParameterError, match=r"none\.yaml: No such file"):
        read_expectations(tmp_path / "none.yaml")


def test_the_name_of_0_3_warns():
    with pytest.warns(DeprecationWarning, match="says is now has_text"):
        assert signal("status.state").says("running") == signal("status.state").has_text("running")
