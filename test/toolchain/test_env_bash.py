"""env.bash in the shells that people have."""

import os
import shutil
import subprocess
from contextlib import suppress
from pathlib import Path

import pytest
from support import extended

ROOT = Path(__file__).resolve().parents[2]

pytestmark = pytest.mark.skipif(
    not (ROOT / ".venv").exists(), reason="set up without make, as a ROS workspace"
)
PROFILE = f"42 SYSTEM_DEFAULT {ROOT}/config/fastdds_loopback.xml"
shells = pytest.mark.parametrize("shell", ["bash", extended("zsh"), "dash", extended("sh")])


def run(
    shell: str, script: str, root: Path = ROOT, **variables: str
) -> subprocess.CompletedProcess:
    """Run a script in a shell that knows nothing of ROS.

    Bash and zsh start in a folder elsewhere; other shells know no other way than ./env.bash.
    """
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    known = shell in ("bash", "zsh")
    file = str(root / "env.bash") if known else "./env.bash"
    environment = {"HOME": os.environ["HOME"], "PATH": os.defpath, "ENV": file}
    return subprocess.run(
        [shell, "-c", script],
        cwd="/" if known else root,
        env={**environment, **variables},
        capture_output=True,
        text=True,
    )


@shells
def test_sourcing_gives_the_commands_and_the_messages(shell):
    commands = "rpud drill_node recorder replayer"
    result = run(shell, f'. "$ENV"; for each in {commands}; do command -v $each; done')
    assert result.stderr == ""
    assert result.stdout.count("/lib/rpud_sim/") == 4
    result = run(shell, '. "$ENV"; python -c "import rclpy, rpud_msgs.msg, rpud_sim; print(1)"')
    assert (result.stdout, result.stderr) == ("1\n", "")


@shells
def test_python_keeps_bytecode_where_a_container_forbids_it(shell):
    variables = {"PYTHONDONTWRITEBYTECODE": "1"}
    command = '. "$ENV"; python -c "import sys; print(sys.dont_write_bytecode)"'
    assert run(shell, command, **variables).stdout == "False\n"


@pytest.mark.parametrize(
    ("variables", "line"),
    [
        ({}, "rpud_sim: ROS_DOMAIN_ID is 42, on this machine only: "),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, "rpud_sim: ROS_DOMAIN_ID is 42: "),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_DOMAIN_ID": "7"}, ""),
    ],
)
def test_a_terminal_shows_once_the_domain_that_is_set(variables, line):
    ours, terminal = os.openpty()
    environment = {"PATH": os.defpath, **variables}
    script = f". {ROOT}/env.bash; . {ROOT}/env.bash; echo end >&2"
    subprocess.run(["bash", "-c", script], env=environment, stderr=terminal, check=True)
    os.close(terminal)
    shown = ""
    with suppress(OSError):  # behind the last line; one read may give one line alone
        while part := os.read(ours, 4096):
            shown += part.decode()
    os.close(ours)
    assert shown.startswith(line)
    assert len(shown.splitlines()) == 1 + bool(line)


@shells
def test_sourcing_twice_changes_nothing(shell):
    variables = "$PATH\n$LD_LIBRARY_PATH\n$AMENT_PREFIX_PATH\n$CMAKE_PREFIX_PATH\n$PYTHONPATH"
    once = run(shell, f'. "$ENV"; echo "{variables}"')
    twice = run(shell, f'. "$ENV"; . "$ENV"; echo "{variables}"')
    assert once.stdout == twice.stdout
    for line in once.stdout.splitlines():
        assert len(line.split(":")) == len(set(line.split(":")))


@shells
def test_sourcing_survives_and_keeps_strict_options(shell):
    result = run(shell, 'set -eu; . "$ENV"; echo sourced; echo "$NOT_SET"; echo survived')
    assert result.returncode != 0
    assert result.stdout == "sourced\n"
    assert "NOT_SET" in result.stderr


@shells
@pytest.mark.parametrize(
    ("own", "expected"),
    [
        ({}, PROFILE),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, PROFILE),
        # The profile would keep it to loopback.
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_DOMAIN_ID": "7"}, "7 SUBNET"),
        ({"FASTRTPS_DEFAULT_PROFILES_FILE": "/my/profiles.xml"}, "42 LOCALHOST /my/profiles.xml"),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, "42 LOCALHOST"),  # it reads no such profile
    ],
    ids=["default", "localhost", "subnet", "own_profile", "other_middleware"],
)
def test_discovery_is_left_to_the_profile_only_where_it_is_read(shell, own, expected):
    range_and_profile = "$ROS_AUTOMATIC_DISCOVERY_RANGE $FASTRTPS_DEFAULT_PROFILES_FILE"
    script = f'. "$ENV"; echo $ROS_DOMAIN_ID {range_and_profile}'
    assert run(shell, script, **own).stdout == f"{expected}\n"


@shells
def test_sourcing_before_set_up_says_what_to_do(shell, tmp_path):
    shutil.copy(ROOT / "env.bash", tmp_path)
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "toolchain", tmp_path / "toolchain", ignore=ignored)
    result = run(shell, '. "$ENV" || echo "code $?"', root=tmp_path)
    assert result.stdout == "code 1\n"
    assert result.stderr == "rpud_sim: not set up yet: run 'make setup' first\n"
