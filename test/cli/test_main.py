"""`rpud` as a whole: help, wrong calls, exit codes, and what it loads."""

import importlib
import os
import re
import shlex
import subprocess
import sys
from argparse import Namespace

import pytest
from sample_bags import write_bag
from support import called, extended

from rpud_sim.cli.main import COMMANDS, build_parser, load_command
from rpud_sim.cli.options import DECLARED, options_from
from rpud_sim.foundation.quantities import ParameterError

HEAVY = ("numpy", "numba", "scipy", "tornado", "mcap", "yaml", "tqdm", "rclpy", "rpud_msgs")
ROS = ("ament_index_python", "rclpy", "rpud_msgs", "std_msgs", "builtin_interfaces")


def test_help_lists_every_command_in_its_group(capsys):
    code, output, errors = called(capsys, "--help")
    assert (code, errors) == (0, "")
    *_, first, second, third, fourth, fifth = output.strip().split("\n\n")
    listed = {}
    for part in (first, second, third, fourth, fifth):
        group, *lines = part.splitlines()
        listed |= {line.split()[0]: group.removesuffix(":") for line in lines}
        assert all(re.fullmatch(r"  \w+ +\w.*", line) for line in lines)
    assert listed == {name: group for name, (group, _) in COMMANDS.items()}


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_every_command_has_an_example_that_is_one(capsys, name):
    code, output, errors = called(capsys, name, "--help")
    assert (code, errors) == (0, "")
    example = load_command(name).example
    assert f"example: {example}" in " ".join(output.split())
    program, *words = shlex.split(example)
    assert program == "rpud"
    assert words[0] == name
    parser = build_parser()
    assert parser.parse_args(words).command == name
    choices = next(action.choices for action in parser._actions if action.dest == "command")
    assert all(action.help for action in choices[name]._actions)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "rpud: the following arguments are required: COMMAND; see rpud --help"),
        (["recrod"], "rpud: argument COMMAND: invalid choice: 'recrod'; did you mean record?"),
        (
            ["simulate", "--bogus"],
            "rpud simulate: unrecognized arguments: --bogus; see rpud simulate",
        ),
        (
            ["run", "--duration", "-1"],
            "rpud run: --duration = -1 s is outside its range [1e-09, 1e+09]",
        ),
        (["sweep"], "rpud sweep: there are no points: give --set or --points"),
        (["sweep", "--set", "mass=1,2"], "rpud sweep: point 0: mass is not a parameter; did you"),
        (["sweep", "--set", "gravity=1", "--out", "a.txt"], "rpud sweep: --out a.txt ends neither"),
        (["run", "--record", ""], "rpud run: --record is empty\n"),
        (["simulate", "--config", ""], "rpud simulate: --config is empty\n"),
        (["compare", "a", ""], "rpud compare: B is empty\n"),
        (["press", "nan"], "rpud press: argument FORCE: 'nan' is not a number; see rpud press"),
        (["inject"], "rpud inject: one of the arguments KIND --list is required"),
        (["inject", "choking", "--list"], "rpud inject: argument --list: not allowed with"),
        (["set", "seed"], "rpud set: 'seed' is not of the form name=value"),
        (["engage", "--namespace", "a//b"], "rpud engage: Invalid namespace: namespace must not"),
        (["record", "--out", "bag", "a//b"], "rpud record: topic = 'a//b' is not allowed: "),
        (["echo", "a b"], "rpud echo: TOPIC = 'a b' is not allowed: "),
    ],
)
def test_a_wrong_call_is_one_line_and_exit_code_2(capsys, words, complaint):
    code, output, errors = called(capsys, *words)
    assert (code, output) == (2, "")
    assert errors.startswith(complaint)
    assert errors.count("\n") == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_no_text_that_a_command_takes_may_be_empty(name):
    # A shell gives it for a variable that is not set: then nothing would be recorded, or written.
    load_command(name)
    for key, field in DECLARED[name].fields.items():
        text = "quantity" not in field.metadata and not isinstance(field.default, bool)
        if field.metadata and text and field.default != "":  # which means none
            for given in ("", [""]):
                with pytest.raises(ParameterError, match="is empty"):
                    options_from(Namespace(**{key: given}), {key: field})


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["press", "3", "--namespace", "a\udce9"], "press: --namespace = 'a\\udce9' is not UTF-8"),
        (["watch", "--address", "\udce9"], "watch: --address = '\\udce9' is not UTF-8"),
        (["simulate", "--set", "a=\udce9"], "simulate: --set = 'a=\\udce9' is not UTF-8"),
        (["echo", "\udce9"], "echo: TOPIC = '\\udce9' is not UTF-8"),
        (["info", "\udce9"], "info: there is no bag at \\udce9"),
    ],
)
def test_only_the_name_of_a_file_may_have_bytes_that_are_no_utf_8(capsys, words, complaint):
    # As a shell in Latin-1 gives them.
    code, output, errors = called(capsys, *words)
    assert (code, output, errors) == (1 if words[0] == "info" else 2, "", f"rpud {complaint}\n")


def test_help_loads_neither_numpy_nor_ros():
    script = (
        "import contextlib, sys; from rpud_sim.cli.main import COMMANDS, main\n"
        "for words in ([], *([name] for name in COMMANDS)):\n"
        "    with contextlib.suppress(SystemExit): main([*words, '--help'])\n"
        f"    print(*words, *(name for name in {HEAVY} if name in sys.modules), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stderr.split()) == (0, [*COMMANDS])


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("rpud run", ["--duration", "1"]),
        extended("rpud record", ["--out", "bag"]),
        extended("rpud replay", ["bag"]),
        ("drill_node", []),
        extended("recorder", ["--out", "bag"]),
        extended("replayer", ["bag"]),
    ],
)
def test_what_needs_ros_says_so_in_one_line_where_there_is_none(lacking, program, words):
    rpud, _, name = program.rpartition(" ")
    if rpud:
        done = lacking(ROS, name, *words)
    else:
        done = lacking(ROS, *words, program=f"rpud_sim.cli.executables:{name}")
    assert (done.returncode, done.stdout) == (1, "")
    remedy = r"pip install 'rpud_sim\[ros\]', or source ROS 2 Jazzy or env\.bash first"
    assert re.fullmatch(rf"{program}: needs \w+: {remedy}\n", done.stderr)


@pytest.mark.parametrize(
    "words",
    [
        ["simulate", "--help"],
        extended(["--help"]),
        extended(["simulate", "--duration", "0.1", "--json"]),
    ],
)
def test_a_reader_that_has_gone_is_no_failure(words):
    reading, writing = os.pipe()
    os.close(reading)
    try:
        done = subprocess.run(
            ["rpud", *words], stdout=writing, stderr=subprocess.PIPE, text=True, check=False
        )
    finally:
        os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")


def test_what_is_unexpected_is_one_line_that_says_how_to_see_the_rest(monkeypatch, capsys):
    def fail(options):
        importlib.import_module("rpud_sim.missing")

    failing = load_command("simulate")._replace(run=fail)
    monkeypatch.setitem(DECLARED, "simulate", failing)
    monkeypatch.delenv("RPUD_TRACEBACK", raising=False)
    code, output, errors = called(capsys, "simulate")
    line = (
        "rpud simulate: unexpected ModuleNotFoundError: No module named 'rpud_sim.missing' "
        "(RPUD_TRACEBACK=1 shows where)\n"
    )
    assert (code, output, errors) == (1, "", line)
    monkeypatch.setenv("RPUD_TRACEBACK", "1")
    code, output, errors = called(capsys, "simulate")
    assert (code, output) == (1, "")
    assert errors.startswith("Traceback (most recent call last):\n")
    assert errors.endswith(line)


@pytest.mark.parametrize("buffered", [True, extended(False)])
@pytest.mark.parametrize(
    ("redirection", "reason"),
    [("> /dev/full", "No space left on device"), (">&-", "Bad file descriptor")],
)
def test_output_that_cannot_be_written_is_one_line(tmp_path, redirection, reason, buffered):
    bag = write_bag(tmp_path / "bag")
    done = subprocess.run(
        ["bash", "-c", f'rpud info "$1" {redirection}', "bash", bag],
        capture_output=True,
        env={**os.environ, "PYTHONUNBUFFERED": "" if buffered else "1"},
        text=True,
        check=False,
    )
    expected = f"rpud info: standard output: {reason}\n"
    assert (done.returncode, done.stdout, done.stderr) == (1, "", expected)


def test_a_folder_that_is_gone_is_named(tmp_path):
    script = 'cd "$1" && rmdir "$1" && rpud simulate --duration 0.01 --bag bag'
    done = subprocess.run(["bash", "-c", script, "bash", tmp_path], capture_output=True, text=True)
    expected = "rpud simulate: the working folder: No such file or directory\n"
    assert (done.returncode, done.stderr) == (1, expected)


# A command in which Ctrl-C comes.
INTERRUPTED = """
import contextlib, signal, sys, threading, types
from rpud_sim.cli import bags, main, options

def interrupt():
    signal.raise_signal(signal.SIGINT)

class Import(types.ModuleType):
    def __getattr__(self, name):
        try:
            interrupt()
        except KeyboardInterrupt:
            raise ImportError("half of it is loaded")

class Dying:
    def __del__(self):
        interrupt()

def goes_on():
    threading.Event().wait(20.0)
    print("it went on")

def run(arguments):
    {}

options.command("info", "", "fail", "", options.BAG)(run)
main.main(["info", "bag"])
"""


@pytest.mark.parametrize(
    ("body", "output"),
    [
        (
            "sys.modules['rpud_sim.bag'] = Import('bag')\n    import rpud_sim.bag as b; b.open",
            "",
        ),
        ("Dying(); goes_on()", ""),
        # As in the import of a module that Cython has compiled.
        ("with contextlib.suppress(BaseException): interrupt()\n    goes_on()", ""),
        (
            "try: interrupt()\n    finally: signal.pause(); signal.pause(); print('cleaned up')",
            "cleaned up\n",
        ),
    ],
)
def test_ctrl_c_ends_quietly_even_where_its_exception_is_dropped(body, output):
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED.format(body)], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, output, "")


@pytest.mark.parametrize(
    ("name", "number", "code"),
    [("record", "SIGTERM", 0), ("watch", "SIGINT", 0), ("watch", "SIGHUP", 129)],
)
def test_what_runs_until_a_signal_is_done_by_one_that_comes_while_it_starts(name, number, code):
    script = f"""
import signal
from rpud_sim.cli.program import run_program
run_program("rpud {name}", lambda: signal.raise_signal(signal.{number}))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    line = "" if code else f"rpud {name}: ended by {number}\n"
    assert (done.returncode, done.stdout, done.stderr) == (code, "", line)


def test_a_signal_waits_while_a_program_still_loads():
    script = """
import signal, sys
sys.argv[0] = "/usr/bin/rpud"
import rpud_sim.cli
signal.raise_signal(signal.SIGTERM)
from rpud_sim.cli.main import main
main(["record", "--out", "/nowhere/bag"])
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    line = "rpud record: ended by SIGTERM\n"
    assert (done.returncode, done.stdout, done.stderr) == (0, "", line)
