"""What the shell has is checked before ROS is loaded, and each refusal names the variable."""

import os
import subprocess
import sys
from importlib.machinery import EXTENSION_SUFFIXES

import pytest

from rpud_sim.foundation.quantities import ExpectedError, ParameterError
from rpud_sim.ros.environment import check_before_load, check_before_start

CYCLONE = {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}


def another_rclpy(tmp_path, compiled=""):
    folder = tmp_path / "humble" / "rclpy"
    folder.mkdir(parents=True)
    (folder / "__init__.py").touch()
    (folder / f"_rclpy_pybind11{compiled}").touch()
    return folder


@pytest.mark.parametrize("program", [("rpud", "press", "3"), ("drill_node",)])
def test_another_middleware_is_named_and_nothing_ends_with_a_code_of_the_library(process, program):
    command = process(*program, env={**os.environ, **CYCLONE})
    assert command.wait() == 2
    assert command.output == (
        f"{' '.join(program[:2])}: RMW_IMPLEMENTATION is rmw_cyclonedds_cpp, which is not "
        "installed: unset RMW_IMPLEMENTATION, or set it to rmw_fastrtps_cpp"
    )


@pytest.mark.extended
def test_pytest_goes_on_beside_another_middleware(tmp_path):
    (tmp_path / "test_two.py").write_text(
        "def test_one(): pass\ndef test_drill(drill): pass\ndef test_three(): pass\n"
    )
    words = (sys.executable, "-m", "pytest", "-q", "test_two.py")
    done = subprocess.run(
        words, cwd=tmp_path, env={**os.environ, **CYCLONE}, capture_output=True, text=True
    )
    assert "2 passed, 1 error" in done.stdout
    assert "DrillError: a drill of a test needs ROS 2 Jazzy: RMW_IMPLEMENTATION is" in done.stdout


def test_a_middleware_that_must_not_be_loaded_is_named():
    asked = {"RCL_ASSERT_RMW_ID_MATCHES": "rmw_cyclonedds_cpp"}
    with pytest.raises(ExpectedError, match=r"^RCL_ASSERT_RMW_ID_MATCHES is rmw_cyclonedds_cpp, "):
        check_before_load(asked, [])
    check_before_load({"RCL_ASSERT_RMW_ID_MATCHES": "rmw_fastrtps_cpp"}, [])


def test_a_middleware_that_is_installed_is_loaded(tmp_path):
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "librmw_cyclonedds_cpp.so").touch()
    check_before_load({**CYCLONE, "AMENT_PREFIX_PATH": f"/nowhere:{tmp_path}"}, [])
    check_before_load({**CYCLONE, "LD_LIBRARY_PATH": f":{tmp_path}/lib"}, [])


@pytest.mark.parametrize(
    ("compiled", "wheels"), [(".cpython-35-other.so", False), (EXTENSION_SUFFIXES[0], True)]
)
def test_the_rclpy_of_another_ros_is_named_with_its_path(tmp_path, compiled, wheels):
    folder = another_rclpy(tmp_path, compiled)
    if wheels:
        (tmp_path / "prefix" / "share" / "rclpy").mkdir(parents=True)
    with pytest.raises(ExpectedError, match=f"PYTHONPATH has another rclpy in front, {folder},"):
        check_before_load({}, [str(folder.parent)], str(tmp_path / "prefix"))


def test_the_rclpy_of_an_installed_ros_is_loaded(tmp_path):
    folder = another_rclpy(tmp_path, EXTENSION_SUFFIXES[0])
    check_before_load({}, [str(folder.parent)], str(tmp_path / "prefix"))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ROS_LOCALHOST_ONLY", "1"),
        ("ROS_DOMAIN_ID", "233"),
        ("ROS_DOMAIN_ID", "-1"),
        ("ROS_DOMAIN_ID", "two"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "local"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/nowhere/mine.xml"),
        ("RCUTILS_LOGGING_USE_STDOUT", "true"),
        ("RCUTILS_COLORIZED_OUTPUT", "always"),
    ],
)
def test_a_variable_that_ros_must_not_start_with_is_named(name, value):
    with pytest.raises((ExpectedError, ParameterError), match=rf"^{name} (is|=) '?{value}"):
        check_before_start({name: value})


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", r"it is not XML \(no element found: line 1, column 0\)"),
        ("<profiles><participant>", "it is not XML"),
        ("export A=1", "it is not XML"),
        ("<profiles/>", "it has no profiles"),
        ("<dds><profiles/></dds>", "it has no profiles"),
        ("<robot><link/></robot>", "it has no profiles"),
    ],
)
def test_profiles_without_which_fast_dds_would_use_every_interface_are_refused(
    tmp_path, text, reason
):
    path = tmp_path / "mine.xml"
    path.write_text(text)
    match = f"^FASTRTPS_DEFAULT_PROFILES_FILE is {path}, and {reason}.*: unset it$"
    with pytest.raises(ExpectedError, match=match):
        check_before_start({"FASTRTPS_DEFAULT_PROFILES_FILE": str(path)})


@pytest.mark.parametrize("root", ["<profiles>{}</profiles>", "<dds><profiles>{}</profiles></dds>"])
def test_profiles_of_a_user_are_accepted(tmp_path, root):
    path = tmp_path / "mine.xml"
    path.write_text(f"<?xml version='1.0'?><!-- mine -->\n{root.format('<participant/>')}")
    check_before_start({"FASTRTPS_DEFAULT_PROFILES_FILE": str(path)})


def test_what_is_not_set_or_set_well_is_accepted():
    check_before_start({})
    check_before_start({"ROS_LOCALHOST_ONLY": "0", "ROS_DOMAIN_ID": "7"})
    check_before_start({"ROS_DOMAIN_ID": "none"}, domain_id=7)
