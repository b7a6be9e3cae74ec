"""Prints the polynomials of ``rpud_sim.model.elementary``: minimax, by Remez's exchange algorithm.

Run it as ``python toolchain/polynomials.py``. Each polynomial has the least possible error relative
to the function that it completes. Its coefficients are rounded to binary64 at the end.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import mpmath
from mpmath import mpf

DIGITS = 50
EXCHANGES = 12
GRID = 60  # points between two roots of the error in which its extremum is sought


class Polynomial(NamedTuple):
    """What a polynomial approximates, and where."""

    function: Callable[[Any], Any]
    weight: Callable[[Any], Any]  # of its error
    low: Any
    high: Any
    degree: int


def _at_zero(value: Any, function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return a function that is continued by a value at zero."""
    return lambda x: mpf(value) if x == 0 else function(x)


def _of_root(function: Callable[[Any], Any]) -> Callable[[Any], Any]:
    return lambda x: function(mpmath.sqrt(x))


def polynomials() -> dict[str, Polynomial]:
    """Return the polynomials by the names that their coefficients have."""
    mpmath.mp.dps = DIGITS
    one = mpf(1)
    # A little more than needed, because the multiples that are taken off are found by rounding.
    eighth = (mpmath.pi / 4 * (1 + mpf(2) ** -20)) ** 2
    half = mpmath.log(2) / 2 * (1 + mpf(2) ** -20)
    widest = ((mpmath.sqrt(2) - 1) / (mpmath.sqrt(2) + 1)) ** 2
    octant = (mpmath.sqrt(2) - 1) ** 2
    return {
        "SINE": Polynomial(
            _of_root(_at_zero(-one / 6, lambda r: (mpmath.sin(r) - r) / r**3)),
            _of_root(_at_zero(0, lambda r: r**3 / mpmath.sin(r))),
            mpf(0),
            eighth,
            5,
        ),
        "COSINE": Polynomial(
            _of_root(_at_zero(one / 24, lambda r: (mpmath.cos(r) - 1 + r * r / 2) / r**4)),
            lambda z: z * z,
            mpf(0),
            eighth,
            5,
        ),
        "EXPONENTIAL": Polynomial(
            lambda r: mpmath.hyp1f1(1, 3, r) / 2,  # (exp(r) - 1 - r) / r^2
            lambda _: one / 8,  # r * r is less
            -half,
            half,
            9,
        ),
        "LOGARITHM": Polynomial(
            _of_root(_at_zero(2 * one / 3, lambda s: (2 * mpmath.atanh(s) - 2 * s) / s**3)),
            _of_root(_at_zero(0, lambda s: s**3 / (2 * mpmath.atanh(s)))),
            mpf(0),
            widest,
            6,
        ),
        "ARC_TANGENT": Polynomial(
            _of_root(_at_zero(-one / 3, lambda t: (mpmath.atan(t) - t) / t**3)),
            _of_root(_at_zero(0, lambda t: t**3 / mpmath.atan(t))),
            mpf(0),
            octant,
            10,
        ),
    }


def _value(coefficients: list[Any], x: Any) -> Any:
    return mpmath.polyval(coefficients[::-1], x)


def minimax(wanted: Polynomial) -> tuple[list[float], float]:
    """Return the coefficients from the constant on, and the greatest weighted error."""
    mpmath.mp.dps = DIGITS
    count = wanted.degree + 2
    middle, span = (wanted.high + wanted.low) / 2, (wanted.high - wanted.low) / 2
    points = [
        middle - span * mpmath.cos(mpmath.pi * (2 * i + 1) / (2 * count)) for i in range(count)
    ]
    coefficients: list[Any] = []
    for _ in range(EXCHANGES):
        matrix, right = mpmath.matrix(count), mpmath.matrix(count, 1)
        for i, x in enumerate(points):
            for j in range(count - 1):
                matrix[i, j] = x**j
            matrix[i, count - 1] = (-1) ** i / wanted.weight(x)
            right[i] = wanted.function(x)
        solution = mpmath.lu_solve(matrix, right)
        coefficients = [solution[j] for j in range(count - 1)]
        points = _extrema(wanted, coefficients, points)
    rounded = [float(c) for c in coefficients]
    error = max(abs(_error(wanted, [mpf(c) for c in rounded], x)) for x in points)
    return rounded, float(error)


def _error(wanted: Polynomial, coefficients: list[Any], x: Any) -> Any:
    return wanted.weight(x) * (_value(coefficients, x) - wanted.function(x))


def _extrema(wanted: Polynomial, coefficients: list[Any], points: list[Any]) -> list[Any]:
    """Return where the error is greatest, between each two of its changes of sign."""
    found = []
    for i, _ in enumerate(points):
        low = wanted.low if i == 0 else (points[i - 1] + points[i]) / 2
        high = wanted.high if i == len(points) - 1 else (points[i] + points[i + 1]) / 2
        sign = mpmath.sign(_error(wanted, coefficients, points[i])) or 1
        grid = [low + (high - low) * j / GRID for j in range(GRID + 1)]
        found.append(max(grid, key=lambda x, s=sign: s * _error(wanted, coefficients, x)))
    return found


def main() -> None:
    """Print each polynomial with the bound of its error."""
    for name, wanted in polynomials().items():
        coefficients, error = minimax(wanted)
        print(f"# {name}: relative error {error:.1e}")
        for coefficient in coefficients:
            print(f"    {coefficient!r},")


if __name__ == "__main__":
    main()
