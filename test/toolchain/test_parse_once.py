"""ROS's generators share what one of them has parsed."""

import importlib.util
import sys
from pathlib import Path

import pytest

HOOK = Path(__file__).parents[2] / "toolchain/parse_once/sitecustomize.py"
DEFINITION = "module a { module msg { struct Force { double force; }; }; };\n"


@pytest.fixture
def hook(monkeypatch, tmp_path):
    parser = pytest.importorskip("rosidl_parser.parser")
    monkeypatch.setattr(parser, "get_ast_from_idl_string", parser.get_ast_from_idl_string)
    monkeypatch.setattr(sys, "orig_argv", ["python", "lib/rosidl_generator_c/rosidl_generator_c"])
    spec = importlib.util.spec_from_file_location("parse_once", HOOK)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(module, "PARSED", tmp_path / "parsed")
    return module


def test_a_definition_is_parsed_once_for_all_processes(hook, monkeypatch):
    parsed = hook.parser.parse_idl_string(DEFINITION)
    monkeypatch.setattr(hook, "parse", None)  # as in a process that has parsed nothing
    again = hook.parser.parse_idl_string(DEFINITION)
    assert again.elements[0].structure.members[0].name == "force"
    assert len(again.elements) == len(parsed.elements) == 1
    assert len([*hook.PARSED.iterdir()]) == 1
