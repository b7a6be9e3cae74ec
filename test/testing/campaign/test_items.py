"""Campaigns as pytest sees them, in runs of pytest of their own: items, artefacts, JUnit, page."""

import json
from pathlib import Path
from xml.etree import ElementTree

pytest_plugins = ["pytester"]

SUPERVISORS = Path(__file__).resolve().parents[1]
CAMPAIGN = f"""\
system:
  command: python supervisor.py works --ros-args -r __ns:=/rpud
  folder: {SUPERVISORS}
  answers: [supervisor/heartbeat]
  hears: [reacting_force]
  answer_timeout: 60.0
duration: 0.6
seeds: [1]
scenarios:
  nominal: {{}}
  jammed: {{faults: [{{kind: free_mass_jammed, onset: 0.3}}]}}
expectations:
  - name: force
    requirement: SAFE-1
    expect: {{always: reacting_force.force < 500 N}}
  - name: never jammed
    requirement: SAFE-2
    expect: {{always: {{not: {{fault: free_mass_jammed}}}}}}
  - name: calm after a jam
    requirement: SAFE-3
    expect:
      after: {{onset: free_mass_jammed}}
      expect: {{eventually: status.drive_enabled is true}}
"""


def run(pytester, *options):
    return pytester.runpytest_subprocess("--rpud-artefacts=left", *options)


def test_runs_are_items_that_leave_artefacts_and_a_page_also_in_parallel(pytester):
    pytester.makefile(".yaml", arm=CAMPAIGN)
    result = run(pytester, "-n2", "--junitxml=junit.xml")
    result.assert_outcomes(passed=1, failed=1)
    left = pytester.path / "left"
    result.stdout.fnmatch_lines(
        [
            "requirement        verdict  nominal * jammed",
            "SAFE-2             failed   passed  * failed",
            "SAFE-3             passed   undecided * passed in 0.00 s",
            "requirements: 3 passed, 1 failed, 0 undecided",
            f"{left}/arm.html",
            "FAILED arm.yaml::jammed seed=1*",
        ]
    )
    folder = left / "arm.yaml-jammed_seed=1"
    assert (folder / "bag" / "metadata.yaml").is_file()
    assert "supervisor.py works" in (folder / "1_supervisor.py.log").read_text()
    assert 'href="arm.yaml-jammed_seed%3D1/report.html"' in (left / "arm.html").read_text()
    runs = json.loads((left / "arm.json").read_text())["runs"]
    assert [each["run"] for each in runs] == ["nominal seed=1", "jammed seed=1"]
    junit = ElementTree.parse(pytester.path / "junit.xml")
    cases = {each.get("name"): each.find("failure") for each in junit.iter("testcase")}
    assert cases["nominal seed=1"] is None
    assert cases["jammed seed=1"].get("message").startswith("[SAFE-2] never jammed: failed")

    again = run(pytester, "--lf", "--collect-only", "-q")
    again.stdout.fnmatch_lines(["arm.yaml::jammed seed=1"])
    again.stdout.no_fnmatch_line("*nominal*")


def test_a_drill_that_fails_says_nothing_about_the_system_under_test(pytester):
    pytester.makefile(".yaml", arm=CAMPAIGN)
    pytester.makeconftest("""
        from rpud_sim.testing.drill import Drill

        step = Drill.step

        def fail(drill, seconds):
            drill._process.process.kill()
            return step(drill, seconds)

        Drill.step = fail
    """)
    result = run(pytester, "arm.yaml::nominal seed=1")
    result.assert_outcomes(failed=1, errors=4)
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
    run(pytester).assert_outcomes(passed=1)
    assert not (pytester.path / "left").exists()
