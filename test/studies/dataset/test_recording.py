"""A recorded run gets the commands of its specification, and its bag is proved."""

import numpy as np
from sample_datasets import parsed

import rpud_sim.bag
from rpud_sim.inspection.verify.verification import verify
from rpud_sim.simulation.versions import engine_versions
from rpud_sim.studies.dataset.plan import plan_runs
from rpud_sim.studies.dataset.recording import Job, record


def test_a_run_is_commanded(tmp_path):
    specification = parsed(
        duration=0.4,
        settling=0.1,
        onset={"minimum": 0.2, "maximum": 0.2},
        lasting=None,
        window={"length": 0.1, "stride": 0.1},
        topics=["mount"],
        fixed={"rock_model": "specific_energy", "feed_model": "arm", "drive_enabled": "false"},
        commands=[
            {"time": 0.1, "feed": {"rate": 1e-3}},
            {"time": 0.3, "feed": {"position": 0.0}, "drive": {"voltage": 100.0}},
        ],
    )
    run = plan_runs(specification)[0]
    recorded = record(Job(0, run, specification, engine_versions()))
    assert recorded.failure == ""
    for name, content in recorded.bag.items():
        (tmp_path / name).write_bytes(content)
    with rpud_sim.bag.open(tmp_path) as bag:
        feed = bag.arrays("/rpud/mount")["feed"]
        kinds = bag.arrays("/rpud/journal")["kind"].tolist()
    np.testing.assert_allclose(feed[[9, 19, 29]], [0.0, 1e-4, 2e-4], atol=1e-9)
    assert feed[-1] == 0.0
    assert kinds.count("feed") == 2
    assert "drive" in kinds
    assert verify(tmp_path).proved
