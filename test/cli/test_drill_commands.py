"""Commands on a running drill: wrong calls end before anything starts."""

import pytest


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["press", "abc"], "rpud press: argument FORCE: 'abc' is not a number; see rpud press"),
        (["press", "nan"], "rpud press: argument FORCE: 'nan' is not a number"),
        (["press"], "rpud press: the following arguments are required: FORCE"),
        (["step", "1 s"], "rpud step: argument SECONDS: '1 s' is not a number"),
        (["inject", "choking", "--for", "0"], "rpud inject: --for = 0 s is outside its range (0"),
        (["inject"], "rpud inject: needs either KIND or --list"),
        (["inject", "choking", "--list"], "rpud inject: needs either KIND or --list"),
        (["clear"], "rpud clear: needs either FAULT or --all"),
        (["clear", "noise", "--all"], "rpud clear: needs either FAULT or --all"),
        (["reset", "--scope", "tim"], "rpud reset: argument --scope: invalid choice: 'tim'"),
        (["reset", "--seed", "-1"], "rpud reset: --seed = -1 is outside its range [0, 4.29497e+09"),
        (["set", "seed"], "rpud set: 'seed' is not of the form name=value"),
        (["play", "--domain", "233"], "rpud play: --domain = 233 is outside its range [0, 232]"),
        (["pause", "--patience", "0"], "rpud pause: --patience = 0 s is outside its range (0"),
        (["engage", "--namespace", "a//b"], "rpud engage: Invalid namespace: namespace must not"),
        (["echo", "a b"], "rpud echo: Invalid topic name"),
        (["echo", "status", "--once", "--count", "2"], "rpud echo: argument --count: not allowed"),
    ],
)
def test_a_wrong_call_is_one_line_and_exit_code_2(rpud, words, complaint):
    code, output, errors = rpud(*words)
    assert (code, output) == (2, "")
    assert errors.startswith(complaint)
    assert errors.count("\n") == 1
