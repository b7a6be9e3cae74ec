"""Runs a notebook and writes its outputs into it: ``python -m toolchain.notebook FILE``.

A code cell shows what it prints and, if its last line is an expression, that value: a figure of
matplotlib as PNG, anything else as text.
"""

from __future__ import annotations

import ast
import json
import os
import sys
from base64 import b64encode
from contextlib import redirect_stdout
from io import BytesIO, StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from matplotlib.figure import Figure

_DPI = 70


def executed(notebook: dict[str, Any]) -> dict[str, Any]:
    """Return a notebook with the outputs of its cells, which are run in an empty folder."""
    scope: dict[str, Any] = {"__name__": "__main__"}
    cells, number = [], 0
    before = Path.cwd()
    with TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for cell in notebook["cells"]:
                if cell["cell_type"] == "code":
                    number += 1
                    found = _outputs(cell, scope, number)
                    cell = {**cell, "execution_count": number, "outputs": found}
                cells.append(cell)
        finally:
            os.chdir(before)
    return {**notebook, "cells": cells}


def _outputs(cell: dict[str, Any], scope: dict[str, Any], number: int) -> list[dict[str, Any]]:
    tree = ast.parse("".join(cell["source"]))
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = StringIO(), None
    with redirect_stdout(printed):
        exec(compile(tree, "cell", "exec"), scope)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "cell", "eval"), scope)
    outputs: list[dict[str, Any]] = []
    if text := printed.getvalue():
        outputs.append({"output_type": "stream", "name": "stdout", "text": _lines(text)})
    if value is not None:
        shown = {"output_type": "execute_result", "execution_count": number, "metadata": {}}
        outputs.append({**shown, "data": _data(value)})
    return outputs


def _data(value: Any) -> dict[str, Any]:
    if isinstance(value, Figure):
        picture = BytesIO()
        value.savefig(picture, format="png", dpi=_DPI, metadata={"Software": None})
        return {"text/plain": ["<Figure>"], "image/png": b64encode(picture.getvalue()).decode()}
    return {"text/plain": _lines(repr(value))}


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def main() -> None:
    """Run the notebooks that are named, and write them."""
    for name in sys.argv[1:]:
        file = Path(name)
        notebook = executed(json.loads(file.read_text(encoding="utf-8")))
        file.write_text(f"{json.dumps(notebook, indent=1)}\n", encoding="utf-8")
        print(file)


if __name__ == "__main__":
    main()
