"""The plugin as pytest sees it, in runs of pytest of their own."""

import base64
import json
import re
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from frame_reader import decode

import rpud_sim.testing.setup  # noqa: F401  # a run in this process forgets what it imports

pytest_plugins = ["pytester"]

SUPERVISOR = Path(__file__).parents[1].joinpath("helpers", "supervisor.py").read_text()
REFUSED = "1 command rejected, the last: weight_on_bit = -1 N is outside its range [[]0, 1000] N"
HEAVY = ("rclpy", "numba", "numpy", "tornado", "rpud_sim.ros", "rpud_sim.simulation")


def test_a_run_without_a_drill_imports_nothing_heavy():
    script = (
        "import sys, rpud_sim.testing.plugin, rpud_sim.testing; "
        f"print([name for name in {HEAVY} if name in sys.modules])"
    )
    assert subprocess.check_output([sys.executable, "-c", script], text=True) == "[]\n"


@pytest.mark.parametrize(
    ("first", "options", "starts"),
    [("drill", (), True), ("drill", ("--collect-only",), False), ("tmp_path", (), False)],
)
def test_the_process_of_a_drill_starts_with_the_tests_if_the_first_has_one(
    pytester, first, options, starts
):
    pytester.makeconftest("""
        import pytest
        from rpud_sim.testing.item_drills import POOL

        @pytest.hookimpl(trylast=True)
        def pytest_collection_finish(session):
            print("starts", POOL in session.config.stash)
            session.items.clear()
    """)
    pytester.makepyfile(f"def test_a({first}): pass\ndef test_b(drill): pass")
    result = pytester.runpytest_inprocess("-s", *options)
    result.stdout.fnmatch_lines([f"*starts {starts}"])


def test_wrong_marks_are_refused_before_anything_starts(pytester):
    pytester.makepyfile("""
        import pytest

        @pytest.mark.rpud(weight_on_bitt=3.0)
        def test_a(drill): pass

        @pytest.mark.rpud("free")
        def test_b(drill): pass

        def test_c(): pass
    """)
    result = pytester.runpytest_inprocess()
    assert result.ret == pytest.ExitCode.USAGE_ERROR
    result.stderr.fnmatch_lines(
        [
            "*::test_a: mark rpud: weight_on_bitt is neither *; did you mean weight_on_bit?",
            "*::test_b: mark rpud: 'free' has no name: write rpud(config=*",
        ]
    )
    result.stdout.no_fnmatch_line("*passed*")


@pytest.mark.extended
def test_failing_tests_leave_artefacts_also_in_parallel_and_passing_ones_nothing(pytester):
    pytester.makefile(".py", supervisor=SUPERVISOR)
    pytester.makepyfile("""
        import pytest
        from rpud_sim.ros.client import RefusedError
        from rpud_sim.verdicts import always, eventually, signal

        def test_passes(drill):
            drill.step(0.1)
            assert drill.time == 0.1

        def test_is_undecided(drill):
            drill.step(0.1)
            drill.expect(eventually(signal("reacting_force.force") > "1 MN", within="1 s"))

        def test_fails(drill):
            drill.press(20.0)
            with pytest.raises(RefusedError):
                drill.press(-1.0)
            drill.with_answers("supervisor/heartbeat")
            drill.start("python supervisor.py works --ros-args -r __ns:=/rpud",
                        subscribes_to=("reacting_force",))
            drill.step(0.2)
            drill.expect(always(signal("reacting_force.force") < "5 N"), name="calm",
                         requirement="R1")
    """)
    options = ("-p", "no:cacheprovider", "-n2", "--junitxml=junit.xml", "--rpud-artefacts=left")
    result = pytester.runpytest_subprocess(*options)
    result.assert_outcomes(passed=1, failed=1, errors=1)
    [folder] = (pytester.path / "left").glob("*fails")
    result.stdout.fnmatch_lines(
        [
            "E *ExpectationFailedError: [[]R1] calm: failed: reacting_force.force was * N at * s; "
            "required: always(reacting_force.force < 5 N) (evaluated at 0.200 s)",
            f"E *{REFUSED}",
            f"artefacts: {folder}",
            f"bag: {folder}/bag",
            REFUSED,
            "    at 0.000 s: press 20.0",
        ]
    )
    assert (folder / "bag" / "metadata.yaml").is_file()
    [frame] = re.findall('class="frame">([^<]*)<', (folder / "report.html").read_text())
    report = decode(base64.b64decode(frame))["report"]
    assert report["test"].endswith("test_fails")
    assert (report["verdict"], report["seed"]) == ("failed", "-1")
    assert report["requirements"][0].startswith("[R1] calm: failed: reacting_force")
    commands = (folder / "commands.txt").read_text()
    assert "press 20.0" in commands
    assert "at 0.000 s: step to 0.2 s" in commands
    assert "drilling: regime drilling" in (folder / "drill.log").read_text()
    assert "supervisor.py works" in (folder / "1_supervisor.py.log").read_text()
    assert "rpud_sim" in json.loads((folder / "versions.json").read_text())["versions"]
    tests = ElementTree.parse(pytester.path / "junit.xml").iter("testcase")
    cases = {case.get("name"): case for case in tests}
    assert cases["test_fails"].find("error") is cases["test_is_undecided"].find("failure") is None
    assert "before it is decided" in cases["test_is_undecided"].find("error").get("message")
    assert not [*cases["test_passes"].iter("property")]
    left = {each.get("name"): each.get("value") for each in cases["test_fails"].iter("property")}
    assert left.pop("rpud_verdict").startswith("[R1] calm: failed")
    assert left == {
        "rpud_artefacts": str(folder),
        "rpud_bag": str(folder / "bag"),
        "rpud_report": str(folder / "report.html"),
    }


def test_undecided_is_an_error_of_every_reporter(pytester):
    pytester.makeconftest("""
        import pytest

        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_makereport(item, call):
            report = yield
            print(f"REPORT {report.when} {report.outcome}")
            return report
    """)
    pytester.makepyfile("""
        import pytest
        from rpud_sim.testing import ExpectationUndecidedError

        def test_a():
            raise ExpectationUndecidedError("nobody knows", ())

        @pytest.mark.xfail
        def test_b():
            raise ExpectationUndecidedError("nobody knows", ())
    """)
    result = pytester.runpytest_inprocess("-s", "-rA")
    result.assert_outcomes(errors=1, xfailed=1)
    reports = [line.split()[-2:] for line in result.outlines if "REPORT" in line]
    assert reports[:3] == [["setup", "passed"], ["setup", "failed"], ["teardown", "passed"]]
    assert reports[4] == ["setup", "skipped"]
    result.stdout.fnmatch_lines(["ERROR *::test_a - *"])


def test_reruns_and_shaken_runs_exclude_each_other(pytester):
    shaken = pytester.runpytest_inprocess("--reruns=1", "--rpud-shake=1")
    assert shaken.ret == pytest.ExitCode.USAGE_ERROR
    shaken.stderr.fnmatch_lines(["*--reruns has no effect with --rpud-shake*"])


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Result of a run of pytest with several tests of a drill: its lines, and its junit.xml."""
    folder = tmp_path_factory.mktemp("session")
    (folder / "test_drills.py").write_text("""
import sys
import pytest
from rpud_sim.ros.client import RefusedError
from rpud_sim.verdicts import always, signal

runs = []

@pytest.mark.flaky(reruns=1)
def test_again(drill):
    runs.append(1)
    drill.step(0.1)
    force = signal("reacting_force.force")
    drill.expect(always(force < f"{len(runs) - 1} MN"), name=f"run {len(runs)}")

def test_rewritten(drill):
    own = [sys.modules[each] for each in sys.modules if each.startswith("rpud_sim.ros")]
    assert own
    assert not [each for each in own if "Rewrit" in type(each.__loader__).__name__]
    assert drill.status

def test_nothing(drill, drill_factory):
    drill.step(0.1)
    drill.press(20.0)

@pytest.mark.filterwarnings("error::pytest.PytestWarning")
def test_nothing_where_a_warning_is_an_error(drill):
    drill.step(0.1)

def test_a_status(drill):
    drill.step(0.1)
    assert drill.status.impacts

def test_an_error(drill):
    with pytest.raises(RefusedError):
        drill.press(-1.0)

def test_an_expectation(drill):
    drill.step(0.1)
    drill.expect(always(signal("reacting_force.force") < "1 kN"))

def test_a_failure(drill):
    drill.step(0.1)
    assert False

def test_a_wrong_call():
    import rpud_sim
    rpud_sim.simulate(-1)
""")
    words = (sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-c", "/dev/null")
    options = ("--rpud-artefacts=", "--junitxml=found.xml", "-rA", "--tb=short")
    done = subprocess.run((*words, *options), cwd=folder, capture_output=True, text=True)
    return done.stdout, ElementTree.parse(folder / "found.xml")


def test_each_run_of_a_test_that_is_run_again_has_its_own_verdicts(session):
    cases = [each for each in session[1].iter("testcase") if each.get("name") == "test_again"]
    found = [each.get("value") for case in cases for each in case.iter("property")]
    verdicts = [" ".join(each.split()[:3]) for each in found]
    assert verdicts == ["run 1: failed:", "run 2: passed,"]


def test_pytest_rewrites_none_of_what_a_drill_needs(session):
    """That would take a second of each start where Python keeps no bytecode."""
    assert re.search(r"^PASSED \S*::test_rewritten$", session[0], re.MULTILINE)


def test_a_passing_test_that_looks_at_nothing_of_its_drill_gets_a_warning(session):
    text = session[0]
    assert "3 failed, 6 passed, 1 warning, 1 rerun" in text
    warning = r"::(\w+)\n  .*Warning: this test has a drill and no expect"
    assert re.findall(warning, text) == ["test_nothing"]
    failed = set(re.findall(r"^FAILED \S*::(\w+)", text, re.MULTILINE))
    strict = "test_nothing_where_a_warning_is_an_error"
    assert failed == {"test_a_failure", "test_a_wrong_call", strict}


def test_an_expected_error_is_shown_where_the_test_caused_it(session):
    """Frames of this package are left out."""
    place = r"_\n\S+:\d+: in test_a_wrong_call\n    rpud_sim.simulate\(-1\)\nE .*duration = -1"
    assert re.search(place, session[0])
