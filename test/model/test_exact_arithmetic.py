"""What decides bits of a bag calls nothing whose rounding differs between machines."""

import ast
from pathlib import Path

import pytest

import rpud_sim

PACKAGE = Path(rpud_sim.__file__).parent
# Where the values of a bag are computed.
ROOMS = ("model", "drilling", "simulation", "foundation", "bag")
# Of math, what is exact or rounded once; the rest is the C library's.
EXACT = {
    *("ceil", "copysign", "fabs", "floor", "fmod", "frexp", "fsum", "inf", "isclose", "isfinite"),
    *("isinf", "isnan", "ldexp", "nan", "nextafter", "pi", "sqrt", "trunc", "ulp"),
}
# NumPy functions that call a library or choose the order of a sum.
INEXACT = {
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh"),
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "hypot", "power", "float_power"),
    *("cbrt", "angle", "sinc", "logaddexp", "logspace", "geomspace", "interp", "gradient"),
    *("dot", "vdot", "inner", "outer", "matmul", "einsum", "tensordot", "linalg", "fft"),
    *("convolve", "correlate", "cov", "corrcoef", "polyfit", "polyval", "trapezoid"),
}
# Random numbers that NumPy draws by logarithms, or by products and sums that a compiler may fuse.
INEXACT_DRAWS = {"normal", "standard_normal", "standard_exponential", "uniform", "poisson"}


def is_inexact(library, name=""):
    return (
        library in ("cmath", "scipy")
        or (library == "math" and bool(name) and name not in EXACT)
        or (library in ("np", "numpy") and name in INEXACT)
    )


def faults(tree):
    """Yield the line and the name of what a module uses that is not exact."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found = [each.name for each in node.names if is_inexact(each.name.partition(".")[0])]
        elif isinstance(node, ast.ImportFrom):
            library = (node.module or "").partition(".")[0]
            found = [each.name for each in node.names if is_inexact(library, each.name)]
        elif isinstance(node, ast.Attribute):
            base = node.value.id if isinstance(node.value, ast.Name) else ""
            found = [node.attr] * (is_inexact(base, node.attr) or node.attr in INEXACT_DRAWS)
        elif isinstance(node, ast.BinOp):
            # Powers of literal numbers are exact where they are used, such as 2.0**32.
            literal = isinstance(node.left, ast.Constant) and isinstance(node.right, ast.Constant)
            found = ["@"] * isinstance(node.op, ast.MatMult)
            found += ["**"] * (isinstance(node.op, ast.Pow) and not literal)
        else:
            found = ["pow"] * (isinstance(node, ast.Name) and node.id == "pow")
        for name in found:
            yield node.lineno, name


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_use_the_elementary_functions(room):
    sources = sorted((PACKAGE / room).rglob("*.py"))
    assert sources
    found = [
        f"{source.relative_to(PACKAGE)}:{line}: {what}"
        for source in sources
        for line, what in faults(ast.parse(source.read_text(encoding="utf-8")))
    ]
    assert found == []
