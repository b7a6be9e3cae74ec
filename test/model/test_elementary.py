"""Elementary functions: errors against mpmath, symmetry, special values, and bits without Numba."""

import math
import os
import subprocess
import sys
from pathlib import Path

import mpmath
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support import MANY_EXAMPLES, examples

from rpud_sim.model import elementary
from rpud_sim.model.elementary import (
    arc_tangent,
    decimal_logarithm,
    exponential,
    exponential_minus_one,
    hypotenuse,
    logarithm,
    logarithm_one_plus,
    power,
    sin_cos,
    sin_cos_cycles,
    sine_and_less,
)

mpmath.mp.prec = 200
TOOLCHAIN = Path(__file__).parents[2] / "toolchain"
GREATEST_ANGLE = 2.6e7
NEAR_ONE = st.floats(-2.0, 2.0)
POSITIVE = st.floats(5e-324, 1.7e308) | st.floats(0.5, 2.0)
ANY = st.floats(allow_nan=False)
FINITE = st.floats(allow_nan=False, allow_infinity=False)


def part(function, number):
    """One of two results, as a function."""
    return lambda x: function(x)[number]


sine, cosine = part(sin_cos, 0), part(sin_cos, 1)
sine_of_cycles, cosine_of_cycles = part(sin_cos_cycles, 0), part(sin_cos_cycles, 1)


def sine_of_twice_pi(x):
    return mpmath.sinpi(2 * x)


def cosine_of_twice_pi(x):
    return mpmath.cospi(2 * x)


def cosine_less_one(x):
    return -2 * mpmath.sin(x / 2) ** 2


def error(function, exact, *arguments):
    """Return the error of a result, absolute and in units in the last place."""
    found = function(*arguments)
    right = exact(*map(mpmath.mpf, arguments))
    if not math.isfinite(float(right)):
        assert found == float(right)
        return 0.0, 0.0
    away = abs(mpmath.mpf(found) - right)
    return float(away), float(away / math.ulp(abs(float(right))))


CYCLES = st.floats(-1e6, 1e6)
EIGHTHS = st.floats(-0.78, 0.78).filter(lambda x: x == 0.0 or abs(x) > 1e-150)
EXPONENTS = st.floats(-750, 715) | NEAR_ONE
BEYOND_MINUS_ONE = st.floats(-1.0, 1.7e308, exclude_min=True) | st.floats(-0.5, 0.5)
# Function, the exact one, bound in ulp, the range of arguments that is covered densely, where it
# rises within that, and arguments that are drawn.
ACCURATE = [
    (sine_of_cycles, sine_of_twice_pi, 2.0, (-3, 3), (-0.25, 0.25), CYCLES),
    (cosine_of_cycles, cosine_of_twice_pi, 2.0, (-3, 3), (-0.5, 0.0), CYCLES),
    (exponential, mpmath.exp, 1.0, (-3, 3), (-3, 3), EXPONENTS),
    (exponential_minus_one, mpmath.expm1, 2.5, (-3, 3), (-3, 3), EXPONENTS),
    (part(sine_and_less, 0), mpmath.sin, 1.5, (-0.78, 0.78), (-0.78, 0.78), EIGHTHS),
    (part(sine_and_less, 1), cosine_less_one, 1.5, (-0.78, 0.78), (-0.78, 0.0), EIGHTHS),
    (logarithm, mpmath.log, 1.0, (0.01, 4), (0.1, 4), POSITIVE),
    (decimal_logarithm, mpmath.log10, 2.0, (0.01, 4), (0.1, 4), POSITIVE),
    (logarithm_one_plus, mpmath.log1p, 1.0, (-0.99, 4), (-0.9, 4), BEYOND_MINUS_ONE),
]


@pytest.mark.parametrize(
    ("function", "exact", "bound", "covered", "rises", "drawn"),
    ACCURATE,
    ids=[exact.__name__ for _, exact, *_ in ACCURATE],
)
def test_error_is_within_its_bound(function, exact, bound, covered, rises, drawn):
    grid = np.linspace(*covered, 20_011 if MANY_EXAMPLES else 2_003).tolist()
    assert max(error(function, exact, x)[1] for x in grid) <= bound
    rising = [function(x) for x in grid if rises[0] <= x <= rises[1]]
    assert rising == sorted(rising)

    @settings(max_examples=examples(500))
    @given(drawn)
    def anywhere(x):
        assert error(function, exact, x)[1] <= bound

    anywhere()


@settings(max_examples=examples(500))
@given(ANY)
@example(2.0**51 + 0.5)
@example(2.0**52 + 1.0)
@example(-(2.0**53) + 1.0)
def test_whole_cycles_are_taken_off_exactly_from_any_number(x):
    if math.isinf(x):
        assert all(map(math.isnan, sin_cos_cycles(x)))
        return
    assert error(sine_of_cycles, sine_of_twice_pi, x)[0] <= 1.5e-16
    assert error(cosine_of_cycles, cosine_of_twice_pi, x)[0] <= 1.5e-16


ANGLES = st.floats(-GREATEST_ANGLE, GREATEST_ANGLE)


@settings(max_examples=examples(1000))
@given(ANGLES | st.floats(-100.0, 100.0) | st.floats(GREATEST_ANGLE, 1e15) | FINITE)
@example(2.0672040070014414e32)
def test_error_of_sine_and_cosine_and_great_angles_give_those_of_a_neighbour(x):
    for s, c in (sin_cos(x), sin_cos_cycles(x)):
        assert abs(s * s + c * c - 1.0) <= 4.5e-16
    bound = 1.6e-16 + (2.0 * math.ulp(x) if abs(x) > GREATEST_ANGLE else 0.0)
    if bound < 1.0:
        assert error(sine, mpmath.sin, x)[0] <= bound
        assert error(cosine, mpmath.cos, x)[0] <= bound


def test_error_of_sine_and_cosine_near_multiples_of_a_quarter_turn():
    quarters = np.concatenate([np.arange(-3000, 3000), np.arange(16_500_000, 16_503_000)])
    for x in (quarters[:: 1 if MANY_EXAMPLES else 10] * (math.pi / 2)).tolist():
        for near in (math.nextafter(x, -math.inf), x, x + math.pi / 4):
            assert error(sine, mpmath.sin, near)[0] <= 1.6e-16
            assert error(cosine, mpmath.cos, near)[0] <= 1.6e-16
    for x in (10.0 ** np.random.default_rng(0).uniform(-300.0, 0.0, 2000)).tolist():
        assert error(sine, mpmath.sin, x)[1] <= 1.5


@settings(max_examples=examples(1000))
@given(FINITE | NEAR_ONE, FINITE | NEAR_ONE)
@example(2.0**-500, 2.0**500)
@example(5e-324, 5e-324)
@example(1.7e308, -1.7e308)
@example(1e-300, -1.7e308)
def test_error_of_angle_and_size_of_a_point(y, x):
    assert error(hypotenuse, mpmath.hypot, y, x)[1] <= 1.2
    if x == 0.0 or y == 0.0:
        assert arc_tangent(y, x) == math.atan2(y, x)
    else:
        assert error(arc_tangent, mpmath.atan2, y, x)[1] <= 2.5


@settings(max_examples=examples(500))
@given(st.floats(1e-10, 1e10), st.floats(-20.0, 20.0))
def test_error_of_powers(base, exponent):
    bound = 2.0 + 1.5 * abs(exponent * math.log(base))
    assert error(power, mpmath.power, base, exponent)[1] <= bound


@given(ANGLES)
def test_symmetry_is_exact(x):
    s, c = sin_cos(x)
    assert sin_cos(-x) == (-s, c)
    s, c = sin_cos_cycles(x)
    assert sin_cos_cycles(-x) == (-s, c)
    assert arc_tangent(-x, 0.7) == -arc_tangent(x, 0.7)
    assert hypotenuse(-x, 2.0) == hypotenuse(2.0, x) == hypotenuse(x, -2.0)


def test_quarters_of_a_cycle_are_exact():
    for number in range(-9, 9):
        turned = sin_cos_cycles(0.25 * number)
        assert turned == ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[number % 4]


C_FUNCTIONS = [
    (sine, np.sin),
    (cosine, np.cos),
    (exponential, np.exp),
    (exponential_minus_one, np.expm1),
    (logarithm, np.log),
    (logarithm_one_plus, np.log1p),
    (decimal_logarithm, np.log10),
]
SPECIAL = [0.0, -0.0, 1.0, -1.0, -2.0, math.inf, -math.inf, math.nan]


@pytest.mark.parametrize(("function", "of_c"), C_FUNCTIONS)
@pytest.mark.parametrize("x", [*SPECIAL, 5e-324])
def test_special_values_are_those_of_c(function, of_c, x):
    with np.errstate(all="ignore"):
        assert function(x) == pytest.approx(float(of_c(x)), rel=4e-16, abs=4e-16, nan_ok=True)


@pytest.mark.parametrize("y", SPECIAL)
@pytest.mark.parametrize("x", SPECIAL)
def test_special_points_are_those_of_c(y, x):
    for function, of_c in ((arc_tangent, math.atan2), (hypotenuse, math.hypot)):
        found, right = function(y, x), of_c(y, x)
        assert found == pytest.approx(right, rel=0.0, abs=4e-16, nan_ok=True)
        assert math.isnan(right) or math.copysign(1.0, found) == math.copysign(1.0, right)


PROGRAM = """
import json, math, random
from rpud_sim.model import elementary

draw = random.Random(0)
numbers = [draw.uniform(-30.0, 30.0) for _ in range(1000)]
numbers += [draw.uniform(-1.0, 1.0) * 2.0 ** draw.randint(-1070, 1020) for _ in range(2000)]
numbers += [0.0, -0.0, math.inf, -math.inf, math.nan]
found = []
for x, y in zip(numbers, numbers[::-1]):
    for one in ("sin_cos", "sin_cos_cycles", "exponential", "exponential_minus_one",
                "logarithm", "logarithm_one_plus", "decimal_logarithm"):
        found.append(getattr(elementary, one)(x))
    for two in ("arc_tangent", "hypotenuse"):
        found.append(getattr(elementary, two)(y, x))
    found.append(elementary.power(abs(x), 0.7))
flat = [number for each in found for number in (each if isinstance(each, tuple) else (each,))]
assert all(type(number) is float for number in flat)
print(json.dumps([number.hex() for number in flat]))
"""


def printed(*words, **environment):
    environment = {**os.environ, **environment}
    words = [sys.executable, *words]
    return subprocess.run(
        words, env=environment, stdout=subprocess.PIPE, text=True, check=True
    ).stdout


def test_python_gives_the_bits_of_kernels():
    assert printed("-c", PROGRAM, NUMBA_DISABLE_JIT="1") == printed("-c", PROGRAM)


@pytest.mark.extended
def test_coefficients_are_those_that_the_repository_computes():
    lines = printed(TOOLCHAIN / "polynomials.py").splitlines()
    coefficients = [line.strip(" ,") for line in lines if line[0] == " "]
    source = Path(elementary.__file__).read_text(encoding="utf-8")
    assert len(coefficients) == 40
    assert [each for each in coefficients if each not in source] == []
