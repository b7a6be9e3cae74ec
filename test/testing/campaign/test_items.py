"""Campaigns as pytest sees them, in runs of pytest of their own: items, artefacts, JUnit, page."""

import json
from xml.etree import ElementTree

import pytest
from campaign_results import CAMPAIGN

pytest_plugins = ["pytester"]

CAMPAIGN += """\
  - name: never jammed
    requirement: SAFE-3
    expect: {always: {not: {fault: free_mass_jammed}}}
"""


def run(pytester, *options):
    return pytester.runpytest_subprocess("--rpud-artefacts=left", *options)


@pytest.mark.extended
def test_runs_are_items_that_leave_artefacts_and_a_page_also_in_parallel(pytester):
    pytester.makefile(".yaml", arm=CAMPAIGN)
    result = run(pytester, "-n2", "--junitxml=junit.xml")
    result.assert_outcomes(passed=1, failed=1)
    left = pytester.path / "left"
    result.stdout.fnmatch_lines(
        [
            "requirement        verdict  calm * jammed",
            "SAFE-2             passed   undecided * passed * in 0.00 s",
            "SAFE-3             failed   passed  * failed",
            "requirements: 3 passed, 1 failed, 0 undecided",
            f"{left}/arm.html",
            "FAILED arm.yaml::jammed seed=0*",
        ]
    )
    folder = left / "arm.yaml-jammed_seed=0"
    assert (folder / "bag" / "metadata.yaml").is_file()
    assert "supervisor.py works" in (folder / "1_supervisor.py.log").read_text()
    assert 'href="arm.yaml-jammed_seed%3D0/report.html"' in (left / "arm.html").read_text()
    runs = json.loads((left / "arm.json").read_text())["runs"]
    assert [each["run"] for each in runs] == ["calm seed=0", "jammed seed=0"]
    junit = ElementTree.parse(pytester.path / "junit.xml")
    cases = {each.get("name"): each.find("failure") for each in junit.iter("testcase")}
    assert cases["calm seed=0"] is None
    assert cases["jammed seed=0"].get("message").startswith("[SAFE-3] never jammed: failed")

    again = run(pytester, "--lf", "--collect-only", "-q")
    again.stdout.fnmatch_lines(["arm.yaml::jammed seed=0"])
    again.stdout.no_fnmatch_line("*calm*")


@pytest.mark.extended
def test_a_drill_that_fails_says_nothing_about_the_system_under_test(pytester):
    pytester.makefile(".yaml", arm=CAMPAIGN)
    pytester.makeconftest("""
        import pytest
        from rpud_sim.testing.drill import LockstepDrill

        step = LockstepDrill.step

        def fail(drill, seconds):
            drill._process.process.kill()
            return step(drill, seconds)

        LockstepDrill.step = fail

        @pytest.hookimpl(wrapper=True)
        def pytest_runtest_makereport(item, call):
            report = yield
            if report.failed:
                print(f"REPORT {item.nodeid} {report.when}")
            return report
    """)
    result = run(pytester, "-s", "arm.yaml::calm seed=0")
    result.assert_outcomes(failed=1, errors=4)
    result.stdout.fnmatch_lines(["*REPORT arm.yaml::SAFE-3 setup"])  # reporters have it, too
    result.stdout.fnmatch_lines(
        ["the drill was ended by SIGKILL; *", "system under test  undecided  undecided"]
    )


def test_other_yaml_files_are_not_collected(pytester):
    texts = (
        "system: {a: 1}\nscenarios: [b]\n",
        CAMPAIGN.replace("answers", "topics"),
        "# system:\n# scenarios:\nversion: 2\n",
        "\xff: [",
        "",
    )
    for number, text in enumerate(texts):
        (pytester.path / f"other_{number}.yaml").write_text(text, encoding="latin-1")
    pytester.makepyfile("def test_a(): pass")
    pytester.runpytest_inprocess("--rpud-artefacts=left").assert_outcomes(passed=1)
    assert not (pytester.path / "left").exists()
