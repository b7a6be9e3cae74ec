"""A ROS parameter file means the same to ``--config`` and to a node that is started with it."""

import pytest
from rclpy.node import Node

from rpud_sim.cli.options import parameter_values
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.yaml_files import parse_yaml
from rpud_sim.ros.drill.drill_node import DrillNode
from rpud_sim.simulation.configuration import to_settings

# What a file has, the values that are the drill's or the error, and names that are left out.
FILES = {
    "all nodes": ("/**: {ros__parameters: {weight_on_bit: 5.0}}", {"weight_on_bit": 5.0}, ""),
    "its name": ("drill_node: {ros__parameters: {gravity: 1.62}}", {"gravity": 1.62}, ""),
    "its full name": ("/left/drill_node: {ros__parameters: {seed: 3}}", {"seed": 3}, ""),
    "without the slash": ("left/drill_node: {ros__parameters: {seed: 3}}", {"seed": 3}, ""),
    "nested namespaces": (
        "left: {drill_node: {ros__parameters: {regime: free}}}",
        {"regime": "free"},
        "",
    ),
    "another namespace": (
        "/**: {ros__parameters: {seed: 1}}\n"
        "right: {drill_node: {ros__parameters: {seed: 2}}}\n"
        "/right/drill_node: {ros__parameters: {no_such: 2}}",
        {"seed": 1},
        "",
    ),
    "another node": (
        "drill_node: {ros__parameters: {seed: 1}}\n"
        "gripper: {ros__parameters: {seed: 2, fingers: 3}}",
        {"seed": 1},
        "",
    ),
    "the later of two": (
        "drill_node: {ros__parameters: {seed: 1, gravity: 1.62}}\n"
        "/**: {ros__parameters: {seed: 2}}",
        {"seed": 2, "gravity": 1.62},
        "",
    ),
    "names of other nodes": (
        "/**: {ros__parameters: {gravity: 1.62, max_speed: 3, arm: {joints: [a, b], gain: 1}}}",
        {"gravity": 1.62},
        "arm.gain, arm.joints, max_speed",
    ),
    "names that YAML and ROS write in two ways": (
        "/**: {ros__parameters: {true: 3, foo: [{a: 1}], seed: 1}}",
        {"seed": 1},
        "True, foo",
    ),
    "a dump": (
        "/left/drill_node:\n  ros__parameters:\n    gravity: 1.62\n    autostart: false\n"
        "    qos_overrides: {/clock: {subscription: {depth: 1}}}\n"
        "    start_type_description_service: true\n    use_sim_time: false\n",
        {"gravity": 1.62, "autostart": False},
        "",
    ),
    "a mistake": (
        "drill_node: {ros__parameters: {wieght_on_bit: 5.0}}",
        ":1: 'wieght_on_bit' is not a key here; did you mean weight_on_bit?",
        "",
    ),
    "a value outside": (
        "/**: {ros__parameters: {gravity: -1.0}}",
        ":1: gravity = -1 m/s^2 is outside its range",
        "",
    ),
    "no number of base 60": (
        "/**:\n  ros__parameters:\n    weight_on_bit: 1:30\n",
        ":3: weight_on_bit = '1:30' is not a number; its range",
        "",
    ),
    "no number with underscores": (
        "/**: {ros__parameters: {weight_on_bit: 1_000}}",
        ":1: weight_on_bit = '1_000' is not a number; its range",
        "",
    ),
    "no binary number": (
        "/**: {ros__parameters: {seed: 0b11}}",
        ":1: seed = '0b11' is not a number; its range",
        "",
    ),
    "numbers of C": (
        "/**: {ros__parameters: {seed: 0x1F, telemetry_rate: 0144, weight_on_bit: 1e1}}",
        {"seed": 31, "telemetry_rate": 100, "weight_on_bit": 10.0},
        "",
    ),
    # As rcl's own files of tests: root_ns, wildcards, multi_ns, params_with_duplicates.
    "the root namespace": (
        "/:\n  left: {drill_node: {ros__parameters: {seed: 4}}}\n"
        "  right/drill_node: {ros__parameters: {no_such: 1}}",
        {"seed": 4},
        "",
    ),
    "sections of all nodes twice": (
        "/**:\n  ros__parameters: {seed: 1, gravity: 1.62}\n"
        "/*/drill_node: {ros__parameters: {seed: 3}}\n"
        "/**:\n  ros__parameters: {regime: free}\n",
        {"seed": 3, "gravity": 1.62, "regime": "free"},
        "",
    ),
    "a key twice in the section of another node": (
        "controller:\n  ros__parameters:\n    path:\n      tolerance: 0.2\n      tolerance: 0.3\n"
        "    gains: [1, 2]\n    gains: {p: 1}\n"
        "/left/drill_node: {ros__parameters: {weight_on_bit: 12.5}}",
        {"weight_on_bit": 12.5},
        "",
    ),
    "a key of another node twice in a section of all": (
        "/**: {ros__parameters: {arm: {gain: 1, gain: 2}, seed: 1}}",
        {"seed": 1},
        "arm.gain",
    ),
    "a key twice in its own section": (
        "drill_node:\n  ros__parameters:\n    seed: 1\n    seed: 2\n",
        ":4: seed occurs twice in one section",
        "",
    ),
    "words of truth": (
        "/**: {ros__parameters: {drive_enabled: off, autostart: n, publish_clock: 'yes'}}",
        {"drive_enabled": False, "autostart": False, "publish_clock": True},
        "",
    ),
}


# Scalars that rcl and PyYAML may read differently.
SCALARS = """
    1e3 1E1 .5 5. +5 -0 0x10 0o7 010 08 09.5 010.5 1_000 1:30 0b11 .inf -.inf yes! 1e 1e+ 1.e1
    .e1 1..2 0x 0x1G 00 -010 --8 1,000 +.5 8f 1d3 8#c true TRUE tRue '8' "8" '' 0xFFFFFFFF
    9223372036854775807 2026:01 1.5e-2 +0x10 ½ . + 'true' a_b
"""


def test_scalars_are_those_of_ros(nodes, tmp_path):
    path, scalars = tmp_path / "robot.yaml", SCALARS.split()
    lines = [f"    p{number}: {text}" for number, text in enumerate(scalars)]
    path.write_text("\n".join(["/**:", "  ros__parameters:", *lines]))
    words = ["--ros-args", "--params-file", str(path)]
    nodes.append(Node("reader", cli_args=words))
    read = [nodes[-1]._parameter_overrides[f"p{n}"].value for n in range(len(scalars))]
    ours = [parse_yaml(text) for text in scalars]
    assert [*map(repr, ours)] == [*map(repr, read)]


class Options:
    """Options of ``rpud run`` with a file."""

    namespace, regime, assignments = "left", None, ()

    def __init__(self, config):
        self.config = config


@pytest.mark.parametrize(("text", "meant", "left_out"), FILES.values(), ids=FILES)
def test_a_file_means_the_same_to_config_and_to_a_node(
    nodes, tmp_path, capfd, text, meant, left_out
):
    path = tmp_path / "robot.yaml"
    path.write_text(text)

    def start():
        words = ["--ros-args", "-r", "__ns:=/left", "--params-file", str(path)]
        nodes.append(DrillNode(cli_args=words))
        return nodes[-1].settings

    if isinstance(meant, str):
        for reading in (lambda: parameter_values(Options(path)), start):
            with pytest.raises(ParameterError) as refused:
                reading()
            assert f"{path}{meant}" in str(refused.value)
        return
    assert parameter_values(Options(path)) == meant
    of_config = capfd.readouterr().err
    assert start() == to_settings(meant)
    of_node = capfd.readouterr().err
    if left_out:
        line = f"{path}: left out, not parameters of the drill: {left_out}\n"
        assert of_config == f"rpud: {line}"
        assert of_node.endswith(line)
        assert of_node.count("\n") == 1
    else:
        assert of_node == ""


def test_config_says_that_it_leaves_out_what_ros_declares(tmp_path, capfd):
    path = tmp_path / "robot.yaml"
    path.write_text("/**: {ros__parameters: {use_sim_time: true, seed: 1}}")
    assert parameter_values(Options(path)) == {"seed": 1}
    line = f"rpud: {path}: left out, not parameters of the drill: use_sim_time\n"
    assert capfd.readouterr().err == line


@pytest.mark.parametrize("value", ["[1, a]", "[1.0, 2]", "{gains: [true, 2]}"])
@pytest.mark.parametrize("section", ["/**", "gripper"])
def test_a_file_that_ros_refuses_is_refused(nodes, tmp_path, section, value):
    path = tmp_path / "robot.yaml"
    own = "drill_node: {ros__parameters: {seed: 1}}"
    path.write_text(f"{own}\n{section}: {{ros__parameters: {{foo: {value}}}}}")
    with pytest.raises(RuntimeError, match="Couldn't parse params file"):
        DrillNode(cli_args=["--ros-args", "--params-file", str(path)])
    with pytest.raises(ParameterError, match=r":2: .* has values of several types"):
        parameter_values(Options(path))


def test_what_is_given_by_name_goes_before_a_file(nodes, tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_text("/left/drill_node: {ros__parameters: {seed: 1, gravity: 1.62}}")
    words = ["--ros-args", "-r", "__ns:=/left", "-p", "seed:=2", "--params-file", str(path)]
    nodes.append(DrillNode(cli_args=words))
    assert nodes[-1].settings == to_settings({"seed": 2, "gravity": 1.62})


@pytest.mark.parametrize(
    ("text", "held"),
    [("gripper: {ros__parameters: {seed: 2}}", "gripper"), ("# later", "no ros__parameters")],
)
def test_a_node_starts_with_a_file_for_others_and_says_so(nodes, tmp_path, capfd, text, held):
    """As every ROS node does; ``--config`` names one file for one drill, and refuses it."""
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    nodes.append(DrillNode(cli_args=["--ros-args", "--params-file", str(path)]))
    assert nodes[-1].settings == to_settings({})
    line = f"{path}:1: nothing is for /drill_node: the file has {held}\n"
    assert capfd.readouterr().err.endswith(line)
    with pytest.raises(ParameterError, match="nothing is for /left/drill_node"):
        parameter_values(Options(path))
