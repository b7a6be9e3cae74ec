"""`rpud test CAMPAIGN.yaml`: exit codes, pytest's options, wrong calls."""

from xml.etree import ElementTree

import pytest
from campaign_results import CAMPAIGN
from support import called, rpud


@pytest.fixture
def campaign(tmp_path):
    file = tmp_path / "campaign.yaml"
    file.write_text(CAMPAIGN)
    return file


@pytest.mark.extended
def test_a_requirement_that_no_run_decides_gives_1_and_a_failed_one_3(campaign, tmp_path):
    junit = tmp_path / "junit.xml"
    words = ("test", campaign, "--only", "calm", "--out", tmp_path / "out", "--junit", junit)
    result = rpud(*words)
    assert result.returncode == 1, result.stdout
    assert "campaign.yaml::SAFE-2" in result.stdout
    assert "1 error in" in result.stdout.splitlines()[-1]
    suite = ElementTree.parse(junit).getroot().find("testsuite")
    assert (suite.get("errors"), suite.get("failures")) == ("1", "0")
    assert "the event of after never came: onset(free_mass_jammed)" in junit.read_text()
    assert "SAFE-2             undecided  undecided" in result.stdout
    campaign.write_text(CAMPAIGN.replace("< 500 N", "< 0 N"))
    result = rpud(*words)
    assert result.returncode == 3, result.stdout
    assert "[SAFE-1] force: failed" in result.stdout


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--expect", "a.yaml"), "--expect is for bags"),
        (("--json",), "--json is for bags"),
        (("--only", "jamed"), "2 deselected"),
        (("--lff",), "unrecognized arguments: --lff"),
    ],
)
def test_a_wrong_call_starts_nothing(capsys, campaign, tmp_path, words, message):
    code, *texts = called(capsys, "test", campaign, "--out", tmp_path / "out", *words)
    assert code == 2
    assert message in "".join(texts)
    assert not (tmp_path / "out").exists()


def test_a_mistake_in_the_file_starts_nothing(capsys, campaign, tmp_path):
    campaign.write_text(CAMPAIGN.replace("kind: free_mass_jammed", "kind: free_mass_jamed"))
    code, output, errors = called(capsys, "test", campaign, "--out", tmp_path / "out")
    assert (code, output) == (2, "")
    assert errors.startswith(f"rpud test: {campaign}:10: ")
    assert "did you mean free_mass_jammed?" in errors
    assert not (tmp_path / "out").exists()
