"""`rpud dataset`: exact labels, proved bags, and the same bytes whatever happens to the work."""

import hashlib
import io
import json
import math
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from distributed import LocalCluster
from fault_signatures import ROWS
from support import rpud, until

import rpud_sim.bag
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.inspection.verify.verification import verify
from rpud_sim.studies.dataset import NOTICE
from rpud_sim.studies.dataset.dataset import make_dataset
from rpud_sim.studies.dataset.evaluation import evaluate_dataset, read_runs
from rpud_sim.studies.dataset.folder import read_content
from rpud_sim.studies.dataset.plan import plan_runs
from rpud_sim.studies.dataset.recording import make_jobs, record
from rpud_sim.studies.dataset.specification import SPLITS, DatasetError
from rpud_sim.studies.dataset.specification_file import parse_specification, read_specification

SPECIFICATION = {
    "seed": 4,
    "duration": 2.0,
    "settling": 0.3,
    "onset": {"minimum": 1.0, "maximum": 1.2},
    "lasting": {"minimum": 0.4, "maximum": 0.5},
    "topics": ["contact_force", "wrench"],
    "window": {"length": 0.1, "stride": 0.05},
    "fixed": {"rock_model": "specific_energy"},
    "varied": {"weight_on_bit": {"minimum": 9.0, "maximum": 11.0}},
    "rocks": {
        "chalk": {"split": "train", "rock_specific_energy": 1.0e7},
        "sandstone": {"split": "validation", "rock_specific_energy": 7.5e7},
        "basalt": {"split": "test", "rock_specific_energy": 2.0e8},
    },
    "faults": [
        {"kind": "free_mass_jammed"},
        {"kind": "bias", "channel": "wrench", "severities": [0.01, 500.0]},
        {"kind": "delayed", "channel": "wrench", "severities": [0.2]},
    ],
}
RUNS = 3 * (1 + 4)


def contents(folder):
    """Return the bytes of each file of a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def finished(folder):
    return {path.parent for path in folder.glob("parts/*/run.json") if path.parent.suffix == ""}


def rows(folder, name):
    return pq.read_table(folder / name).to_pylist()


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    path = tmp_path_factory.mktemp("specification") / "spec.yaml"
    path.write_text(yaml.safe_dump(SPECIFICATION))
    return path


@pytest.fixture(scope="module")
def made(spec, tmp_path_factory):
    """A data set by one worker that nothing happened to."""
    folder = tmp_path_factory.mktemp("dataset") / "new" / "made"
    done = rpud("dataset", spec, "--out", folder, "--workers", 1)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def test_it_is_said_loudly_that_the_data_are_synthetic(made):
    folder, printed = made
    assert printed.startswith(NOTICE)
    assert NOTICE in (folder / "README.md").read_text()
    assert json.loads((folder / "dataset.json").read_text())["notice"] == NOTICE
    for path in folder.rglob("*.parquet"):
        assert NOTICE in pq.read_metadata(path).metadata[b"rpud_sim"].decode()


def test_the_folder_holds_what_its_content_says(made):
    folder, printed = made
    content = json.loads((folder / "dataset.json").read_text())
    held = contents(folder)
    assert set(held) == {*content["files"], "dataset.json", "manifest.json"}
    for name, digest in content["files"].items():
        assert hashlib.sha256(held[name]).hexdigest() == digest
    assert (content["runs"], content["failures"], content["seed"]) == (RUNS, 0, 4)
    assert f"{RUNS} runs of 2 s: {RUNS} run, 0 kept, 0 failed" in printed


def test_a_rock_is_in_one_split_only(made):
    folder, _ = made
    for table in ("runs", "windows", "wrench", "contact_force"):
        rocks = {s: {row["rock"] for row in rows(folder, f"{table}/{s}.parquet")} for s in SPLITS}
        assert rocks == {"train": {"chalk"}, "validation": {"sandstone"}, "test": {"basalt"}}


def test_every_bag_is_proved_and_its_ground_truth_is_the_label(made):
    folder, _ = made
    for run in rows(folder, "runs/test.parquet"):
        bag = folder / run["bag"]
        assert verify(bag).proved
        with rpud_sim.bag.open(bag) as opened:
            last = opened.arrays("/rpud/faults")["faults"][-1]
        if run["kind"] == "healthy":
            assert (last, run["onset"], run["clear"]) == ([], None, None)
            continue
        (truth,) = last
        for name in ("kind", "channel", "magnitude"):
            assert truth[name] == run[name]
        for name in ("onset", "clear"):
            time_of = truth[name]
            assert time_of["sec"] * 10**9 + time_of["nanosec"] == run[f"{name}_ns"]


def test_every_sample_and_window_has_the_exact_label(made):
    folder, _ = made
    runs = {run["run"]: run for run in rows(folder, "runs/test.parquet")}
    samples = pq.read_table(folder / "wrench/test.parquet")
    stamps = samples["header.stamp"].cast("int64").to_pylist()
    seen = set()
    for stamp, row in zip(
        stamps, samples.drop(["header.stamp", "log_time"]).to_pylist(), strict=True
    ):
        run = runs[row["run"]]
        lasts = run["onset_ns"] is not None and run["onset_ns"] <= stamp < run["clear_ns"]
        assert row["label"] == (run["kind"] if lasts else "healthy")
        assert row["severity"] == (run["severity"] if lasts else 0)
        assert row["channel"] == (run["channel"] if lasts else "")
        assert row["time"] == stamp / 1e9
        seen.add(row["label"])
    assert seen == {"healthy", "free_mass_jammed", "bias", "delayed"}
    for row in rows(folder, "windows/test.parquet"):
        run = runs[row["run"]]
        share = 0.0
        if run["onset"] is not None:
            overlap = min(row["end"], run["clear"]) - max(row["start"], run["onset"])
            share = max(overlap, 0.0) / 0.1
        assert row["share"] == pytest.approx(share, abs=1e-6)
        assert (row["label"] != "healthy") == (row["share"] > 0.0)


def test_a_fault_shows_in_the_features(made):
    folder, _ = made
    windows = pq.read_table(folder / "windows/test.parquet").to_pandas()
    mean = windows.groupby(["label", "severity"])["wrench.wrench.force.z.mean"].mean()
    assert mean["bias", 2] - mean["healthy", 0] == pytest.approx(500.0, rel=0.3)
    late = windows[windows.run == "basalt-delayed-wrench-1-0"]
    assert late["wrench.delay"].max() == pytest.approx(0.2)
    assert late["wrench.count"].min() == 0
    jammed = windows[(windows.label == "free_mass_jammed") & (windows.share == 1.0)]
    assert (jammed["contact_force.count"] == 0).any()
    assert np.isnan(jammed["contact_force.peak_force.mean"]).any()


def test_a_killed_call_goes_on_and_two_workers_give_the_same_bytes(spec, made, tmp_path, process):
    out = tmp_path / "out"
    killed = process("rpud", "dataset", spec, "--out", out, "--workers", "2")
    until(lambda: len(finished(out)) > 1)
    killed.kill()
    kept = {path: (path / "run.json").stat().st_mtime_ns for path in finished(out)}
    assert 1 < len(kept) < RUNS
    torn = sorted(kept)[0]  # as if the machine had lost power
    table = torn / "wrench.parquet"
    table.write_bytes(table.read_bytes()[:-20])
    (out / "bags" / "test" / "basalt-healthy-0.part").mkdir(parents=True)
    again = rpud("dataset", spec, "--out", out, "--workers", 2, "--json")
    assert again.returncode == 0, again.stderr  # on a busy machine it shows its progress as well
    printed = json.loads(again.stdout)
    assert (printed["kept"], printed["run"]) == (len(kept) - 1, RUNS - len(kept) + 1)
    assert printed["notice"] == NOTICE
    assert contents(out) == contents(made[0])


def test_a_cluster_gives_the_same_bytes(spec, made, tmp_path):
    out = tmp_path / "out"
    with LocalCluster(  # in this process, which has loaded everything
        n_workers=1,
        threads_per_worker=1,
        processes=False,
        dashboard_address=None,
        protocol="tcp",
    ) as cluster:
        make_dataset(read_specification(spec), out, 1, cluster.scheduler_address)
    assert contents(out) == contents(made[0])


def test_a_finished_data_set_is_not_run_again_and_another_is_refused(spec, made, tmp_path):
    folder, _ = made
    before = contents(folder)
    assert f"0 run, {RUNS} kept" in rpud("dataset", spec, "--out", folder).stdout
    other = tmp_path / "other.yaml"
    other.write_text(yaml.safe_dump(SPECIFICATION | {"seed": 5}))
    refused = rpud("dataset", other, "--out", folder)
    assert refused.returncode == 2
    assert refused.stderr == (
        f"rpud dataset: {folder}/manifest.json: is of another dataset: specification.seed is 4 "
        "there and 5 here; choose another --out\n"
    )
    assert contents(folder) == before


def test_the_evaluation_prints_a_table_of_the_baselines(made):
    folder, _ = made
    done = rpud("dataset", "--evaluate", folder)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == NOTICE
    head = "detector faults detected F1 false alarms [1/h] median delay [s] greatest delay [s]"
    assert " ".join(lines[1].split()) == head
    assert lines[2].split()[:2] == ["threshold", "4"]
    assert "changepoynt" in done.stdout  # its row, or why there is none


def test_the_threshold_finds_what_is_great_and_not_what_is_small(made):
    evaluation = evaluate_dataset(made[0])
    threshold = evaluation.results[0]
    assert (threshold.detector, threshold.metrics.faults, evaluation.runs) == ("threshold", 4, 5)
    great, small = threshold.by_fault["bias", 2], threshold.by_fault["bias", 1]
    assert great.detected == 1
    assert 0.0 < great.delay_median < 0.2  # two windows
    assert small.detected == 0  # far below what the drill itself does


def test_a_damaged_table_is_not_evaluated(made, tmp_path):
    folder, _ = made
    for name in ("dataset.json", "runs", "windows"):
        (tmp_path / name).symlink_to(folder / name)
    assert read_runs(tmp_path, "test", read_content(tmp_path))
    (tmp_path / "windows").unlink()
    (tmp_path / "windows").mkdir()
    data = (folder / "windows/test.parquet").read_bytes()
    (tmp_path / "windows/test.parquet").write_bytes(data[:-1] + b"\0")
    reason = f"{tmp_path}/windows/test.parquet: is not the file whose digest dataset.json has"
    with pytest.raises(DatasetError, match=f"^{reason}$"):
        read_runs(tmp_path, "test", read_content(tmp_path))


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["missing.yaml", "--out", "out"], "missing.yaml: No such file or directory"),
        (["--out", "out"], "--out needs SPEC; see rpud dataset --help"),
        (["missing.yaml"], "one of the arguments --out --evaluate is required"),
        (["missing.yaml", "--evaluate", "out"], "SPEC does not go with --evaluate"),
        (["--evaluate", "out", "--workers", "2"], "--workers does not go with --evaluate"),
    ],
)
def test_a_wrong_call_is_one_line_and_exit_code_2(words, complaint):
    done = rpud("dataset", *words)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"rpud dataset: {complaint}")
    assert done.stderr.count("\n") == 1


CONFIG = Path(__file__).parents[2] / "config"


@pytest.mark.parametrize(("name", "runs"), [("dataset_example", 160), ("dataset_on_an_arm", 75)])
def test_an_example_in_the_configuration_is_one(name, runs):
    example = read_specification(CONFIG / f"{name}.yaml")
    assert example.run_count == runs
    assert {rock.split for rock in example.rocks.values()} == set(SPLITS)
    # Not the same layers in two splits.
    strata = [rock.parameters.get("strata") for rock in example.rocks.values()]
    assert len(set(strata)) == len(strata) or strata[0] is None


def test_the_example_on_an_arm_has_every_fault_that_an_instrument_sees():
    example = read_specification(CONFIG / "dataset_on_an_arm.yaml")
    assert {series.kind for series in example.faults} == set(ROWS) - {"bit_walk"}


@pytest.fixture(scope="module")
def made_on_an_arm(tmp_path_factory):
    """The example on an arm at small size: three rocks, four faults, short runs."""
    folder = tmp_path_factory.mktemp("arm")
    content = yaml.safe_load((CONFIG / "dataset_on_an_arm.yaml").read_text())
    rocks = ("limestone", "sandstone", "sandstone_on_hard_sandstone")
    kinds = ("binding", "feed_stall", "arm_slip", "corkscrewing")
    content |= {
        "duration": 2.5,
        "settling": 0.5,
        "onset": {"minimum": 1.0, "maximum": 1.2},
        "lasting": {"minimum": 0.8, "maximum": 1.0},
        "window": {"length": 0.1, "stride": 0.05},
        "healthy": 1,
        "rocks": {name: content["rocks"][name] for name in rocks},
        "faults": [{"kind": kind} for kind in kinds],
    }
    (folder / "spec.yaml").write_text(yaml.safe_dump(content))
    return folder, content


def test_the_example_on_an_arm_at_small_size_prints_the_table(
    made_on_an_arm, optional_packages, tmp_path
):
    """Both baselines, the real changepoynt among them."""
    folder, _ = made_on_an_arm
    done = rpud("dataset", folder / "spec.yaml", "--out", tmp_path / "out", "--workers", 1)
    assert done.returncode == 0, done.stderr
    assert "15 runs of 2.5 s: 15 run, 0 kept, 0 failed" in done.stdout
    table = rpud("dataset", "--evaluate", tmp_path / "out")
    assert table.returncode == 0, table.stderr
    lines = table.stdout.splitlines()
    assert lines[0] == NOTICE
    results = {line.split()[0]: line.split()[1:] for line in lines[2:4]}
    assert [results[name][0] for name in ("threshold", "changepoynt")] == ["4", "4"]
    assert int(results["threshold"][1]) >= 2  # torque of binding is seven-fold
    assert "not installed" not in table.stdout


def test_a_run_on_an_arm_has_its_feed_the_same_bytes_and_its_proof(made_on_an_arm, tmp_path):
    _, content = made_on_an_arm
    specification = parse_specification(content)
    runs = plan_runs(specification)
    (job,) = [
        job
        for job in make_jobs(specification, runs, frozenset())
        if job.run.name == "sandstone_on_hard_sandstone-arm_slip-1-0"
    ]
    first = record(job)
    assert first == record(job)
    for name, data in first.bag.items():
        (tmp_path / name).write_bytes(data)
    assert verify(tmp_path).proved
    with rpud_sim.bag.open(tmp_path) as bag:
        mount = bag.arrays("/rpud/mount")
    assert mount["rate"][-1] == pytest.approx(1.6e-4)
    assert mount["slip"][-1] < 0.0  # away from the rock
    table = pq.read_table(io.BytesIO(first.tables["windows"]))
    assert "mount.force.mean" in table.column_names
    assert not [name for name in table.column_names if name.startswith("mount.slip")]


@pytest.mark.parametrize(
    ("feed_rate", "fixed", "reason"),
    [
        (1.0, {}, "rocks.chalk: feed rate = 1 m/s is outside its range [-0.005, 0.005]"),
        (math.nan, {}, "rocks.chalk.feed_rate = nan m/s is outside its range"),
        (1e-4, {"feed_model": "none"}, "rocks.chalk: a feed cannot be commanded with feed_model"),
    ],
)
def test_a_feed_that_the_drill_cannot_make_is_refused(feed_rate, fixed, reason):
    content = {key: value for key, value in SPECIFICATION.items() if key != "varied"}
    rocks = dict(content["rocks"])
    rocks["chalk"] = {**rocks["chalk"], "feed_rate": feed_rate}
    content |= {
        "rocks": rocks,
        "fixed": {"feed_model": "arm", "rock_model": "specific_energy", **fixed},
    }
    with pytest.raises((DatasetError, ParameterError)) as refused:
        parse_specification(content)
    assert reason in str(refused.value)
