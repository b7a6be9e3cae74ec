"""Elementary functions: errors against mpmath, symmetry, special values, and bits without Numba."""

import json
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

from rpud_sim.model import elementary
from rpud_sim.model.elementary import (
    arc_tangent,
    complex_exponential,
    complex_phase,
    complex_size,
    decimal_logarithm,
    exponential,
    exponential_minus_one,
    hypotenuse,
    logarithm,
    logarithm_one_plus,
    power,
    sin_cos,
    sin_cos_cycles,
)

mpmath.mp.prec = 200
TOOLCHAIN = Path(__file__).parents[2] / "toolchain"
GREATEST_ANGLE = 2.6e7
NEAR_ONE = st.floats(-2.0, 2.0)
POSITIVE = st.floats(5e-324, 1.7e308)
ANY = st.floats(allow_nan=False)


def sine(x):
    return sin_cos(x)[0]


def cosine(x):
    return sin_cos(x)[1]


def sine_of_cycles(x):
    return sin_cos_cycles(x)[0]


def cosine_of_cycles(x):
    return sin_cos_cycles(x)[1]


def error(function, exact, *arguments):
    """Return the error of a result, absolute and in units in the last place."""
    found = function(*arguments)
    right = exact(*map(mpmath.mpf, arguments))
    if not math.isfinite(float(right)):
        assert found == float(right)
        return 0.0, 0.0
    away = abs(mpmath.mpf(found) - right)
    return float(away), float(away / math.ulp(abs(float(right))))


def of_cycles(function):
    return lambda x: function(2 * x)


# Function, the exact one, bound in ulp, the range of arguments that is covered densely, and those
# that are drawn.
ACCURATE = {
    "sine_of_cycles": (sine_of_cycles, of_cycles(mpmath.sinpi), 2.0, (-3, 3), st.floats(-1e6, 1e6)),
    "cosine_of_cycles": (
        *(cosine_of_cycles, of_cycles(mpmath.cospi), 2.0, (-3, 3), st.floats(-1e6, 1e6)),
    ),
    "exponential": (exponential, mpmath.exp, 1.0, (-3, 3), st.floats(-750, 715) | NEAR_ONE),
    "minus_one": (
        *(exponential_minus_one, mpmath.expm1, 2.5, (-3, 3), st.floats(-750, 715) | NEAR_ONE),
    ),
    "logarithm": (logarithm, mpmath.log, 1.0, (0.01, 4.0), POSITIVE | st.floats(0.5, 2.0)),
    "decimal_logarithm": (
        *(decimal_logarithm, mpmath.log10, 2.0, (0.01, 4.0), POSITIVE | st.floats(0.5, 2.0)),
    ),
    "one_plus": (
        *(logarithm_one_plus, mpmath.log1p, 1.0, (-0.99, 4.0)),
        st.floats(-1.0, 1.7e308, exclude_min=True) | st.floats(-0.5, 0.5),
    ),
}


@pytest.mark.parametrize("name", ACCURATE)
def test_error_is_within_its_bound(name):
    function, exact, bound, covered, drawn = ACCURATE[name]
    grid = np.linspace(*covered, 20_011).tolist()
    assert max(error(function, exact, x)[1] for x in grid) <= bound

    @settings(max_examples=500)
    @given(drawn)
    def anywhere(x):
        assert error(function, exact, x)[1] <= bound

    anywhere()


@settings(max_examples=500)
@given(ANY)
@example(2.0**51 + 0.5)
@example(2.0**52 + 1.0)
@example(-(2.0**53) + 1.0)
def test_whole_cycles_are_taken_off_exactly_from_any_number(x):
    if math.isinf(x):
        assert all(map(math.isnan, sin_cos_cycles(x)))
        return
    assert error(sine_of_cycles, of_cycles(mpmath.sinpi), x)[0] <= 1.5e-16
    assert error(cosine_of_cycles, of_cycles(mpmath.cospi), x)[0] <= 1.5e-16


@settings(max_examples=500)
@given(st.floats(-GREATEST_ANGLE, GREATEST_ANGLE) | st.floats(-100.0, 100.0))
def test_error_of_sine_and_cosine(x):
    assert error(sine, mpmath.sin, x)[0] <= 1.6e-16
    assert error(cosine, mpmath.cos, x)[0] <= 1.6e-16


def test_error_of_sine_and_cosine_near_multiples_of_a_quarter_turn():
    quarters = np.concatenate([np.arange(-3000, 3000), np.arange(16_500_000, 16_503_000)])
    for x in (quarters * (math.pi / 2)).tolist():
        for near in (math.nextafter(x, -math.inf), x, x + math.pi / 4):
            assert error(sine, mpmath.sin, near)[0] <= 1.6e-16
            assert error(cosine, mpmath.cos, near)[0] <= 1.6e-16


@settings(max_examples=500)
@given(st.floats(GREATEST_ANGLE, 1e15) | st.floats(GREATEST_ANGLE, 1.7e308))
@example(2.0672040070014414e32)
def test_great_angles_give_those_of_a_neighbour(x):
    found_sine, found_cosine = sin_cos(x)
    assert abs(found_sine * found_sine + found_cosine * found_cosine - 1.0) <= 4.5e-16
    bound = 2.0 * math.ulp(x) + 1.6e-16
    if bound < 1.0:
        assert error(sine, mpmath.sin, x)[0] <= bound
        assert error(cosine, mpmath.cos, x)[0] <= bound


def test_small_angles_keep_their_relative_precision():
    for x in (10.0 ** np.random.default_rng(0).uniform(-300.0, 0.0, 2000)).tolist():
        assert error(sine, mpmath.sin, x)[1] <= 1.5


FINITE = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=1000)
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


@settings(max_examples=500)
@given(st.floats(1e-10, 1e10), st.floats(-20.0, 20.0))
def test_error_of_powers(base, exponent):
    bound = 2.0 + 1.5 * abs(exponent * math.log(base))
    assert error(power, mpmath.power, base, exponent)[1] <= bound


@settings(max_examples=300)
@given(NEAR_ONE, st.floats(-100.0, 100.0))
def test_complex_functions_are_those_of_the_parts(real, imaginary):
    number = complex(real, imaginary)
    sine_of, cosine_of = sin_cos(imaginary)
    size = exponential(real)
    assert complex_exponential(number) == complex(size * cosine_of, size * sine_of)
    assert complex_phase(number) == arc_tangent(imaginary, real)
    assert complex_size(number) == hypotenuse(real, imaginary)


@given(st.floats(-GREATEST_ANGLE, GREATEST_ANGLE))
def test_symmetry_is_exact(x):
    s, c = sin_cos(x)
    assert sin_cos(-x) == (-s, c)
    s, c = sin_cos_cycles(x)
    assert sin_cos_cycles(-x) == (-s, c)
    assert arc_tangent(-x, 0.7) == -arc_tangent(x, 0.7)
    assert hypotenuse(-x, 2.0) == hypotenuse(2.0, x) == hypotenuse(x, -2.0)


@given(st.floats(-GREATEST_ANGLE, GREATEST_ANGLE))
def test_sine_and_cosine_lie_on_the_unit_circle(x):
    for s, c in (sin_cos(x), sin_cos_cycles(x)):
        assert abs(s * s + c * c - 1.0) <= 4.5e-16
        assert max(abs(s), abs(c)) <= 1.0


def test_quarters_of_a_cycle_are_exact():
    for number in range(-9, 9):
        turned = sin_cos_cycles(0.25 * number)
        assert turned == ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))[number % 4]


@pytest.mark.parametrize(
    ("function", "low", "high"),
    [
        (sine_of_cycles, -0.25, 0.25),
        (exponential, -3.0, 3.0),
        (exponential_minus_one, -3.0, 3.0),
        (logarithm, 0.1, 10.0),
        (logarithm_one_plus, -0.9, 10.0),
    ],
)
def test_functions_rise_on_a_grid(function, low, high):
    values = [function(x) for x in np.linspace(low, high, 50_021).tolist()]
    assert values == sorted(values)


C_FUNCTIONS = [
    (sine, math.sin),
    (cosine, math.cos),
    (exponential, math.exp),
    (exponential_minus_one, math.expm1),
    (logarithm, math.log),
    (logarithm_one_plus, math.log1p),
    (decimal_logarithm, math.log10),
]


@pytest.mark.parametrize(("function", "of_c"), C_FUNCTIONS)
@pytest.mark.parametrize("x", [0.0, -0.0, -1.0, math.inf, -math.inf, math.nan, 1e308, 5e-324])
def test_special_values_are_those_of_c(function, of_c, x):
    if abs(x) == 1e308 and function in (sine, cosine):
        assert abs(function(x)) <= 1.0
        return
    try:
        right = of_c(x)
    except OverflowError:
        right = math.inf
    except ValueError:  # Python's word for what is NaN or -inf in C
        right = -math.inf if x in (0.0, -1.0) and "log" in of_c.__name__ else math.nan
        if x == -1.0 and of_c is not math.log1p:
            right = math.nan
    found = function(x)
    assert math.isclose(found, right, rel_tol=4e-16) or (math.isnan(found) and math.isnan(right))


@pytest.mark.parametrize("y", [0.0, -0.0, 1.0, -2.0, math.inf, -math.inf, math.nan])
@pytest.mark.parametrize("x", [0.0, -0.0, 1.0, -2.0, math.inf, -math.inf, math.nan])
def test_special_points_are_those_of_c(y, x):
    for found, right in (
        (arc_tangent(y, x), math.atan2(y, x)),
        (hypotenuse(y, x), math.hypot(y, x)),
    ):
        if math.isnan(right):
            assert math.isnan(found)
        else:
            assert abs(found - right) <= 4e-16 or found == right
            assert math.copysign(1.0, found) == math.copysign(1.0, right)


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


def bits(**environment):
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        check=True,
        timeout=120,
    )
    return json.loads(done.stdout)


def test_python_gives_the_bits_of_kernels():
    assert bits(NUMBA_DISABLE_JIT="1") == bits()


def test_coefficients_are_those_that_the_repository_computes():
    done = subprocess.run(
        [sys.executable, TOOLCHAIN / "polynomials.py"],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=120,
    )
    coefficients = [line.strip(" ,") for line in done.stdout.splitlines() if line[0] == " "]
    source = Path(elementary.__file__).read_text(encoding="utf-8")
    assert len(coefficients) == 40
    assert [each for each in coefficients if each not in source] == []
