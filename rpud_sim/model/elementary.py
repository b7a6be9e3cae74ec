"""Elementary functions with the same bits on every machine.

They use only what IEEE 754 defines to the last bit: additions, subtractions, multiplications,
divisions and square roots of binary64. Their order and grouping are part of the result. The same
code runs in kernels and in Python.

Each function reduces its argument to a short range, in which a polynomial completes the first terms
of the series (``toolchain/polynomials.py``). Errors are in units in the last place (ulp). Odd and
even functions are so exactly, but for the sign of a zero. NaN and infinity give what they give in
C. Where a function rises, its results may fall by as much as their errors.
"""

import math

import numpy as np

from rpud_sim.model.compile import compiled

# Added and subtracted, it rounds to the nearest whole number.
_ROUND = 6755399441055744.0  # 1.5 * 2**52

# pi/2 in parts: the first two have 29 bits, so that 2**24 multiples of them are exact.
_QUARTER_1 = 1.570796325802803
_QUARTER_2 = 9.920935808982456e-10
_QUARTER_3 = -1.2177051777973966e-18
_QUARTERS_PER_RADIAN = 0.6366197723675814
_GREATEST_ANGLE = 2.6e7  # [rad]
_TWO_PI = 6.283185307179586

# pi/4 in parts: the first has 50 bits, so that its first multiples are exact.
_EIGHTH_1 = 0.7853981633974483
_EIGHTH_2 = 3.061616997868383e-17
_EIGHTH_TANGENT = 0.41421356237309503  # tangent of pi/8

# log(2) in parts: the first has 32 bits.
_LOG_2_1 = 0.6931471806019545
_LOG_2_2 = -4.2009150726810846e-11
_DOUBLINGS_PER_UNIT = 1.4426950408889634  # 1 / log(2)
_DECADES_PER_UNIT = 0.4342944819032518  # 1 / log(10)

# exp(x) is finite and normal for arguments up to this.
_MOST_DOUBLINGS = 708.0
_NO_DOUBLING = 0.34  # up to this exp(x) has none
_BELOW_NORMAL = math.ldexp(1.0, -128)
_SQUARE_ROOT_OF_HALF = 0.7071067811865476

# Squares of magnitudes between these neither overflow nor lose bits.
_LEAST_SQUARED = math.ldexp(1.0, -400)
_GREATEST_SQUARED = math.ldexp(1.0, 500)
_SCALE = math.ldexp(1.0, 600)

# Two numbers up to this have a finite sum.
_GREATEST_SUMMED = math.ldexp(1.0, 1000)

# Powers of two: of 64 n - 1024 and of 0 to 63.
_FAR_POWERS = np.array([math.ldexp(1.0, 64 * n - 1024) for n in range(32)])
_NEAR_POWERS = np.array([math.ldexp(1.0, n) for n in range(64)])


@compiled
def _pair(z, a, b):
    return a + z * b


@compiled
def _pairs(z, w, a, b, c, d, e, f):
    """Return a polynomial of z with six coefficients, given w = z^2."""
    return _pair(z, a, b) + w * (_pair(z, c, d) + w * _pair(z, e, f))


@compiled
def _sine_and_parts(r):
    """Return the sine of an angle up to pi/4 [rad], and h and p of its cosine 1 - h + p."""
    z = r * r
    w = z * z
    a, b, c = -0.1666666666666663, 0.008333333333322118, -0.000198412698295898
    d, e, f = 2.7557313621453654e-06, -2.5050747770751343e-08, 1.5896230488619227e-10
    sine = r + r * z * _pairs(z, w, a, b, c, d, e, f)
    a, b, c = 0.0416666666666666, -0.0013888888888874138, 2.480158728949149e-05
    d, e, f = -2.755731435515062e-07, 2.087572367270663e-09, -1.1359669288081694e-11
    return sine, 0.5 * z, w * _pairs(z, w, a, b, c, d, e, f)


@compiled
def _sine_and_cosine(r):
    sine, half, part = _sine_and_parts(r)
    rest = 1.0 - half
    return sine, rest + (((1.0 - rest) - half) + part)


@compiled
def sine_and_less(angle):
    """Return the sine, and the cosine less 1, of an angle up to pi/4 [rad], within 1.5 ulp."""
    sine, half, part = _sine_and_parts(angle)
    return sine, part - half


@compiled
def _turned(sine, cosine, quarters):
    """Return sine and cosine after a number of quarter turns."""
    # Without branches, which would be mispredicted every other time.
    is_odd = float(quarters & 1) != 0.0
    first = cosine if is_odd else sine
    second = sine if is_odd else cosine
    return first * (1.0 - (quarters & 2)), second * (1.0 - ((quarters + 1) & 2))


@compiled
def sin_cos_cycles(cycles):
    """Return sine and cosine of any number of cycles, each 2 pi; within 1.5e-16, and 2 ulp."""
    # Where this does not round to the nearest it is still off by a whole number.
    part = cycles - ((cycles + _ROUND) - _ROUND)
    quarters = (4.0 * part + _ROUND) - _ROUND
    sine, cosine = _sine_and_cosine(_TWO_PI * (part - 0.25 * quarters))
    # From -4 to 4 quarters. Without whole numbers, so that several are turned together.
    is_odd = abs(abs(quarters) - 2.0) == 1.0
    first = cosine if is_odd else sine
    second = sine if is_odd else cosine
    first = -first if abs(abs(quarters - 0.5) - 2.0) < 1.0 else first
    return first, -second if abs(abs(quarters + 0.5) - 2.0) < 1.0 else second


@compiled
def sin_cos(angle):
    """Return sine and cosine of an angle [rad], within 1.6e-16.

    Beyond 2.6e7 rad they belong to an angle within 2 ulp. Angles of the engine end with a
    segment, after 10 ms: few reach a thousand.
    """
    if not abs(angle) <= _GREATEST_ANGLE:
        return sin_cos_cycles(angle / _TWO_PI)
    quarters = (angle * _QUARTERS_PER_RADIAN + _ROUND) - _ROUND
    r = ((angle - quarters * _QUARTER_1) - quarters * _QUARTER_2) - quarters * _QUARTER_3
    sine, cosine = _sine_and_cosine(r)
    return _turned(sine, cosine, int(quarters))


@compiled
def _power_of_two(exponent):
    places = exponent + 1024
    return float(_FAR_POWERS[places >> 6]) * float(_NEAR_POWERS[places & 63])


@compiled
def growth_near(r):
    """Return exp(r) - 1 of a size up to 0.34, within 2.5 ulp."""
    z = r * r
    w = z * z
    low = _pair(r, 0.5000000000000001, 0.16666666666666674)
    low += z * _pair(r, 0.04166666666662416, 0.00833333333332221)
    high = _pair(r, 0.0013888888917198688, 0.00019841269886576346)
    high += z * _pair(r, 2.4801521319527276e-05, 2.7557242356039655e-06)
    highest = _pair(r, 2.7620077125270555e-07, 2.5110041863631634e-08)
    return r + z * (low + w * (high + w * highest))


@compiled
def _growth(x):
    """Return whole doublings n and growth q, with exp(x) = 2**n (1 + q) and abs(q) < 0.42."""
    doublings = (x * _DOUBLINGS_PER_UNIT + _ROUND) - _ROUND
    r = (x - doublings * _LOG_2_1) - doublings * _LOG_2_2
    return int(doublings), growth_near(r)


@compiled
def exponential(x):
    """Return exp(x), within 1 ulp."""
    if abs(x) <= _MOST_DOUBLINGS:
        doublings, growth = _growth(x)
        power = _power_of_two(doublings)
        return power + power * growth
    if x != x:
        return math.nan
    if x > 710.0:
        return math.inf
    if x < -746.0:
        return 0.0
    doublings, growth = _growth(x)
    if x > 0.0:
        power = _power_of_two(doublings - 1)
        return 2.0 * (power + power * growth)
    # Rounded once, where it loses bits.
    power = _power_of_two(doublings + 128)
    return (power + power * growth) * _BELOW_NORMAL


@compiled
def exponential_minus_one(x):
    """Return exp(x) - 1, within 2.5 ulp."""
    if abs(x) <= _NO_DOUBLING:
        return growth_near(x)
    if abs(x) <= _MOST_DOUBLINGS:
        doublings, growth = _growth(x)
        power = _power_of_two(doublings)
        return power * growth + (power - 1.0)
    if x < 0.0:
        return -1.0
    return exponential(x)


@compiled
def _logarithm(f, doublings, correction):
    """Return log(1 + f) + doublings log(2) + a small correction; 1 + f from 0.7 to 1.42."""
    s = f / (2.0 + f)
    z = s * s
    w = z * z
    low = _pair(z, 0.6666666666666734, 0.3999999999941635)
    middle = _pair(z, 0.2857142874201829, 0.22222198610566157)
    high = _pair(z, 0.181835624139196, 0.15314098660944825) + w * 0.1479547649659288
    series = z * (low + w * (middle + w * high))
    # log(1 + f) = 2 s + s series, as 2 s = f - f^2 / 2 + s f^2 / 2.
    half = 0.5 * f * f
    rest = s * (half + series) + (doublings * _LOG_2_2 + correction)
    return doublings * _LOG_2_1 - ((half - rest) - f)


@compiled
def _halved(x):
    """Return m - 1 and n, with x = m 2**n and m from 0.7 to 1.42."""
    part, doublings = math.frexp(x)
    if part < _SQUARE_ROOT_OF_HALF:
        return 2.0 * part - 1.0, float(doublings - 1)
    return part - 1.0, float(doublings)


@compiled
def logarithm(x):
    """Return the natural logarithm, within 1 ulp; NaN of negative numbers, -inf of zero."""
    if 0.0 < x < math.inf:
        f, doublings = _halved(x)
        return _logarithm(f, doublings, 0.0)
    if x == 0.0:
        return -math.inf
    return math.inf if x > 0.0 else math.nan


@compiled
def logarithm_one_plus(x):
    """Return log(1 + x), within 1 ulp; NaN below -1, -inf at -1."""
    if -0.25 < x < 0.375:
        return _logarithm(x, 0.0, 0.0)
    total = 1.0 + x
    if not 0.0 < total < math.inf:
        return logarithm(total)
    lost = 1.0 - (total - x) if x > 1.0 else x - (total - 1.0)
    f, doublings = _halved(total)
    return _logarithm(f, doublings, lost / total)


@compiled
def decimal_logarithm(x):
    """Return the logarithm to the base of ten, within 2 ulp."""
    return logarithm(x) * _DECADES_PER_UNIT


@compiled
def power(base, exponent):
    """Return base**exponent of a positive base, within 2 + 1.5 abs(exponent log(base)) ulp."""
    return exponential(exponent * logarithm(base))


@compiled
def arc_tangent(y, x):
    """Return the angle of the point (x, y), from -pi to pi [rad], within 2.5 ulp; as C's atan2."""
    if x != x or y != y:
        return math.nan
    great = abs(x)
    small = abs(y)
    eighths = 0.0
    sign = 1.0
    if great < small:
        great, small = small, great
        eighths = 2.0
        sign = -1.0
    if great == math.inf:
        small = 1.0 if small == math.inf else 0.0
        great = 1.0
    elif great > _GREATEST_SUMMED:
        great *= 0.25
        small *= 0.25
    elif great == 0.0:
        great = 1.0
    if small > _EIGHTH_TANGENT * great:
        t = (small - great) / (small + great)
        eighths += sign
    else:
        t = small / great
    z = t * t
    w = z * z
    low = _pair(z, -0.333333333333332, 0.19999999999953244)
    low += w * _pair(z, -0.14285714280166262, 0.11111110782143277)
    middle = _pair(z, -0.09090897724983625, 0.07692059713587113)
    middle += w * _pair(z, -0.06663099168177951, 0.05847859060377735)
    high = _pair(z, -0.05039189630918983, 0.03806212305226724) + w * -0.017905024038004556
    part = t + t * z * (low + (w * w) * (middle + (w * w) * high))
    if math.copysign(1.0, x) < 0.0:
        eighths = 4.0 - eighths
        sign = -sign
    angle = eighths * _EIGHTH_1 + (sign * part + eighths * _EIGHTH_2)
    return math.copysign(angle, y)


@compiled
def hypotenuse(x, y):
    """Return the square root of x^2 + y^2, within 1.2 ulp; infinite if either is."""
    great = abs(x)
    small = abs(y)
    if great < small:
        great, small = small, great
    if _LEAST_SQUARED < great < _GREATEST_SQUARED:
        return math.sqrt(great * great + small * small)
    if great == math.inf or small == math.inf:
        return math.inf
    if great != great or small != small:
        return math.nan
    scale = _SCALE if great < 1.0 else 1.0 / _SCALE
    great *= scale
    small *= scale
    return math.sqrt(great * great + small * small) / scale


@compiled
def complex_exponential(exponent):
    size = exponential(exponent.real)
    sine, cosine = sin_cos(exponent.imag)
    return complex(size * cosine, size * sine)


@compiled
def complex_phase(number):
    return arc_tangent(number.imag, number.real)


@compiled
def complex_size(number):
    return hypotenuse(number.real, number.imag)


@compiled
def complex_quotient(number, divisor):
    """Return the quotient of two complex numbers, by Smith's algorithm as CPython and Numba do."""
    if abs(divisor.real) >= abs(divisor.imag):
        ratio = divisor.imag / divisor.real
        size = divisor.real + divisor.imag * ratio
        real, imaginary = number.real + number.imag * ratio, number.imag - number.real * ratio
    else:
        ratio = divisor.real / divisor.imag
        size = divisor.real * ratio + divisor.imag
        real, imaginary = number.real * ratio + number.imag, number.imag * ratio - number.real
    return complex(real / size, imaginary / size)


# What Python calls, with arguments of the types that it has.
CALLED_BY_PYTHON = (
    (sin_cos, (1.0,)),
    (sin_cos_cycles, (1.0,)),
    (exponential, (1.0,)),
    (exponential_minus_one, (1.0,)),
    (logarithm_one_plus, (1.0,)),
    (power, (1.0, 1.0)),
    (arc_tangent, (1.0, 1.0)),
    (hypotenuse, (1.0, 1.0)),
    (complex_phase, (1j,)),
    (complex_size, (1j,)),
)
