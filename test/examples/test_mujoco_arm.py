"""A drill beside MuJoCo: the loop closes, and what the exchange of a step costs is bounded."""

import importlib
import itertools
import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.signal import welch
from scipy.stats import sem, ttest_ind
from support import SECOND, Process

import rpud_sim

FOLDER = Path(__file__).parents[2] / "examples" / "mujoco_arm"
TIMEOUT = SECOND // 10  # `command_timeout` of drill.yaml [ns]
pytestmark = pytest.mark.extended


@pytest.fixture(scope="module")
def press():
    """The example, with the optional packages of ``make test-all``."""
    folder = os.environ.get("RPUD_OPTIONAL", "")
    if not folder:
        pytest.skip("RPUD_OPTIONAL names no folder of optional.lock, as `make test-all` does")
    sys.path[:0] = [folder, str(FOLDER)]
    try:
        yield importlib.import_module("press")
    finally:
        del sys.path[:2]


def flown(press, step=0.001, duration=20.0):
    arm = press.Arm(step)
    return press.fly(arm, press.drill_here(arm.place, step), duration)


@pytest.fixture(scope="module")
def flight(press):
    return flown(press)


def test_the_two_commands_of_its_page_print_what_it_shows(press):
    page = (FOLDER / "README.md").read_text()
    commands = re.search(r"```sh\n(.*?)```\n\n```text\n(.*?)```", page, re.DOTALL)
    install, drill = commands[1].splitlines()
    assert install.startswith("python -m pip install mujoco")  # `make test-all` has, apart
    path = os.pathsep.join([os.environ.get("PYTHONPATH", ""), os.environ["RPUD_OPTIONAL"]])
    command = [sys.executable, FOLDER.parents[1] / shlex.split(drill)[1], "3"]
    env = {**os.environ, "PYTHONPATH": path}
    done = subprocess.run(command, env=env, capture_output=True, text=True, check=True)
    numbers = re.compile(r"\d+(\.\d+)?")
    assert numbers.sub("0", done.stdout) == numbers.sub("0", commands[2])


def test_the_arm_drills_through_two_layers_and_lets_go_of_a_jam(flight):
    depth, time, force = flight["depth"], flight["time"], flight["reacting_force"]
    assert depth[-1] > 0.005
    rates = np.diff(np.interp([0.5, 2.0, 5.0, 14.0], time, depth)) / (1.5, 3.0, 9.0)
    assert rates[0] > 2.0 * rates[2]  # chalk, and then limestone
    drilling = force[(time > 5.0) & (time < 15.0)]
    assert drilling.mean() == pytest.approx(20.0, abs=1.0)  # the arm's weight on the bit
    assert flight["place"][-1] < flight["depth"][-1] - 0.005
    assert force[time > 17.0].mean() < 5.0


def test_the_force_on_the_mount_is_what_the_joints_bear(flight):
    """Without the rock the joints carry the arm's weight; with it less, by the reacting force."""
    time = flight["time"]
    free = flight["shoulder"][time > 17.0].mean()
    drilling = flight["shoulder"][(time > 5.0) & (time < 15.0)].mean()
    lever = 0.8975  # of the mount about the shoulder [m]
    assert drilling - free == pytest.approx(
        lever * (20.0 - flight["reacting_force"][time > 17.0].mean()), rel=0.1
    )


def test_another_step_changes_no_mean_by_more_than_a_fiftieth(press):
    means = []
    for step in (0.0005, 0.001, 0.002):
        short = flown(press, step, 8.0)
        drilling = short["time"] > 3.0
        rate = np.polyfit(short["time"][drilling], short["depth"][drilling], 1)[0]
        means.append((short["reacting_force"][drilling].mean(), rate))
        print(f"{1e3 * step:g} ms: {means[-1][0]:.2f} N, {6e4 * rate:.2f} mm/min")
    for finer, coarser in itertools.pairwise(means):
        assert coarser == pytest.approx(finer, rel=0.02)


SPRING = """<mujoco><option timestep="{step}" gravity="0 0 0" integrator="implicitfast"/>
<worldbody><body><joint type="slide" axis="0 0 1" stiffness="{k}" damping="{c}" springref="{feed}"/>
<geom size="0.01" mass="{mass}"/></body></worldbody></mujoco>"""
FEED, TELEMETRY = 5e-3, {"telemetry_rate": 1000}
ARM = rpud_sim.Drill().run.parameters  # the values of the built-in arm


class Spring:
    """One joint of MuJoCo: a mass on a linear spring and damper, which carries the drill."""

    def __init__(self, start, mass, step=0.001, parts=1, k=None, c=None, **values):
        import mujoco

        self.advance, self.parts, self.step, self.mass = mujoco.mj_step, parts, step, mass
        self.k, self.c = k or ARM["arm_stiffness"], c or ARM["arm_damping"]
        words = {"step": step / parts, "k": self.k, "c": self.c, "feed": FEED, "mass": mass}
        self.model = mujoco.MjModel.from_xml_string(SPRING.format(**words))
        self.data = mujoco.MjData(self.model)
        self.data.qpos[0] = start
        given = {"feed_model": "given", "feed_rate_limit": 1.0, "initial_feed": start}
        self.drill = rpud_sim.Drill(**given, **TELEMETRY, **values)

    def fly(self, duration):
        """Mount [m], its velocity [m/s], and reacting force [N]: at the end of each step."""
        rows = []
        for _ in range(round(duration / self.step)):
            self.drill.move(float(self.data.qpos[0]), float(self.data.qvel[0]))
            self.drill.step(self.step)
            self.data.qfrc_applied[0] = -self.drill.reacting_force
            for _ in range(self.parts):
                self.advance(self.model, self.data)
            rows.append((self.data.qpos[0], self.data.qvel[0], self.drill.reacting_force))
        return np.array(rows).T


def test_half_the_step_has_half_of_the_error_or_less(press):
    """Beside the exact solution of mass, both springs and both dampers in one system."""
    start, mass, k, c = 4.9e-3, 4.0, 1e4, 100.0
    rate, damping = ARM["load_spring_rate"], np.sqrt(ARM["load_spring_rate"])
    system = np.array([[0.0, 1.0], [-(k + rate) / mass, -(c + damping) / mass]])
    middle, errors = k * FEED / (k + rate), []
    for step in (8e-3, 4e-3, 2e-3, 1e-3, 5e-4):
        # MuJoCo's own step is short: its error is of the first order.
        heavy = Spring(start, mass, step, round(step / 1e-5), k, c, drive_enabled=False)
        place = heavy.fly(0.2)[0]
        times = step * np.arange(1, len(place) + 1)
        exact = [(expm(system * t) @ [start - middle, 0.0])[0] + middle for t in times]
        errors.append(np.abs(place - exact).max())
    print(f"error at 8 to 0.5 ms: {', '.join(f'{1e6 * each:.2f} um' for each in errors)}")
    for coarse, fine in itertools.pairwise(errors):
        assert fine < 0.55 * coarse


BANDS = ((2, 8), (8, 25), (25, 80), (80, 250))  # [Hz]
NAMES = ["mean force [N]", "mean place [m]"]
NAMES += [f"log power of {n}, {a}-{b} Hz" for n in ("force", "place") for a, b in BANDS]


def figures(force, place):
    """Means and logarithms of powers in four bands of frequency, of force and place."""
    found = [force.mean(), place.mean()]
    for series in (force, place):
        frequencies, power = welch(series, 1000.0, nperseg=1024)
        for low, high in BANDS:
            found.append(np.log(power[(frequencies >= low) & (frequencies < high)].sum()))
    return found


def test_a_linear_arm_of_mujoco_is_the_built_in_arm(press):
    skipped, own, others = 500, [], []
    for seed in range(1, 17):
        drill = rpud_sim.Drill(
            feed_model="arm", initial_feed=FEED, anchoring_force=1e3, seed=seed, **TELEMETRY
        )
        rows = []
        for _ in range(3000):
            drill.step(0.001)
            rows.append(drill.reacting_force)
        place = drill.run["mount"]["position"]
        own.append(figures(np.array(rows[skipped:]), place[skipped:]))
    for seed in range(101, 109):
        # The built-in mount has no mass: 0.1 kg shows above 300 Hz only.
        place, _, force = Spring(4.6e-3, 0.1, 5e-4, seed=seed).fly(3.0)
        place, force = place[1::2], force.reshape(-1, 2).mean(axis=1)
        others.append(figures(force[skipped:], place[skipped:]))
    own, others = np.array(own), np.array(others)
    error = np.hypot(sem(own), sem(others))
    for name, *found in zip(NAMES, own.mean(0), others.mean(0), error, strict=True):
        print("{:25} built-in {:.6g}, MuJoCo {:.6g}, error {:.2g}".format(name, *found))
    # All ten at once, at a level of 99 %.
    assert ttest_ind(own, others, equal_var=False).pvalue.min() > 0.001
    assert error[0] < 0.01 * own.mean(0)[0]
    assert error[1] < 0.002 * own.mean(0)[1]
    assert error[2:].max() < 0.25  # of the logarithm of a power


def test_momentum_and_energy_that_leave_one_simulator_arrive_in_the_other(press):
    duration, step = 3.0, 0.001
    spring = Spring(4.6e-3, 0.5)
    place, velocity, force = spring.fly(duration)
    before = np.concatenate([[4.6e-3], place[:-1]])
    # Momentum: what MuJoCo's spring and damper give, less what its mass keeps, reaches the rock.
    given = spring.k * (FEED - before) - spring.c * velocity  # as its integrator takes them
    given = (given * step).sum() - spring.mass * velocity[-1]
    assert given == pytest.approx((force * step).sum(), abs=1e-9)
    drill = spring.drill
    now, own = drill.now(), drill.run.parameters
    impulse = drill.run["contact_force"]["impulse"].sum()
    kept = own["rpud_mass"] * now["nodal_plane_velocity"]
    kept += own["free_mass"] * (now["free_mass_velocity"] - own["gravity"] * duration)
    print(f"momentum {given - kept:.5g} N s from MuJoCo, {impulse:.5g} N s by impacts")
    assert impulse == pytest.approx(given - kept, rel=1e-4)
    # Energy: work of the mount in MuJoCo, and that which the drill took.
    account = drill.run.metrics["feed_account"]
    work = (force * (place - before)).sum()
    throughput = np.abs(force * (place - before)).sum()
    print(f"work of the mount {work:.4g} J in MuJoCo, {account['feed_work']:.4g} J in the drill")
    assert account["feed_work"] == pytest.approx(work, abs=0.02 * throughput)
    assert abs(account["coupling"]) < 0.02 * drill.run.metrics["energy_account"]["actuator_work"]


def test_over_ros_the_arm_is_the_clock_of_the_drill_and_its_part_is_proved(press, tmp_path):
    bag = tmp_path / "bag"
    path = os.pathsep.join([os.environ.get("PYTHONPATH", ""), os.environ["RPUD_OPTIONAL"]])
    options = (
        "--set",
        "use_sim_time=true",
        "--quiet",
        "--config",
        FOLDER / "drill.yaml",
        "--record",
        bag,
    )
    arm = (sys.executable, FOLDER / "arm_node.py", "0.5")
    with Process("rpud", "run", *options) as drill:
        with Process(*arm, env={**os.environ, "PYTHONPATH": path}) as moved:
            moved.wait_for_line("^hole ")
            assert moved.wait() == 0
        drill.interrupt()
        assert drill.wait() == 0, drill.output
    found = rpud_sim.verify(bag)
    assert found.proved
    assert found.topics["/rpud/wrench"].equal >= 500
    with rpud_sim.open(bag) as opened:
        motions = opened.arrays("/rpud/command/mount")
        assert len(motions["position"]) == 500
        assert len(opened.arrays("/rpud/arm/joint_states")["position"]) == 500
        mount = opened.arrays("/rpud/mount")
        stamps, times = motions["header.stamp"], mount["header.stamp"]
        # Each position is on the line of a sample, however late that came to the drill.
        delays = times[:, np.newaxis] - stamps
        lines = motions["position"] + motions["velocity"] * delays / SECOND
        lines[(delays <= 0) | (delays > TIMEOUT)] = np.nan
        moving = (times > stamps[5]) & (times < stamps[-1])
        apart = np.abs(mount["position"][:, np.newaxis] - lines)[moving]
        assert np.nanmin(apart, axis=1).max() < 1e-12
