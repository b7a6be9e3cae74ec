"""Install rpud_sim, in a ROS 2 workspace (colcon) or as a plain Python package (pip)."""

from glob import glob
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "rpud_sim"
manifest = ElementTree.parse("package.xml").getroot()
VERSION = manifest.findtext("version")

# ROS 2 Jazzy as wheels, as toolchain/requirements/ros.in pins them.
ROS = [
    "ros-jazzy-rclpy[fastrtps]==7.1.6",
    "ros-jazzy-builtin-interfaces==2.0.3",
    "ros-jazzy-diagnostic-msgs==5.3.6",
    "ros-jazzy-geometry-msgs==5.3.6",
    "ros-jazzy-lifecycle-msgs==2.0.3",
    "ros-jazzy-rosgraph-msgs==2.0.3",
    "ros-jazzy-sensor-msgs==5.3.6",
    "ros-jazzy-std-msgs==5.3.6",
    "ros-jazzy-std-srvs==5.3.6",
]
WEB = ["scipy", "tornado"]
EXPORT = ["pyarrow"]
STUDIES = ["scipy", *EXPORT]

setup(
    name=PACKAGE,
    version=VERSION,
    description=" ".join(manifest.findtext("description").split()),
    license=manifest.findtext("license"),
    maintainer=manifest.findtext("maintainer"),
    maintainer_email=manifest.find("maintainer").get("email"),
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed"],
        f"{PACKAGE}.bag": ["share/*/msg/*.msg"],
        f"{PACKAGE}.kernels": ["compiled/*.kernel"],
        f"{PACKAGE}.pages": ["share/*.css"],
        f"{PACKAGE}.viewer": ["share/*", "share/vendor/*"],
    },
    python_requires=">=3.10",
    # What every command needs. Where an extra is missing, the program says which.
    install_requires=[
        "apsw",
        "jinja2",
        "lz4",
        "mcap",
        "numba",
        "numpy",
        "pyyaml",
        "rosbags",
        "tqdm",
        "zstandard",
    ],
    extras_require={
        "ros": [*ROS, f"rpud_msgs=={VERSION}"],
        "web": WEB,  # watch, report, compare: whatever writes or serves a page of recorded runs
        "report": WEB,  # the same by its former name
        "export": EXPORT,
        "studies": STUDIES,  # sweep, fit
        "cluster": [*STUDIES, "distributed"],
        # What the plugin and campaigns need: each leaves a page. toolchain/requirements/test.in
        # says why an older pytest.
        "test": ["pytest<8.4", *WEB],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{PACKAGE}/config", sorted(glob("config/*.*"))),
        (f"share/{PACKAGE}/config/ros2_control", sorted(glob("config/ros2_control/*"))),
        (f"share/{PACKAGE}/urdf", sorted(glob("urdf/*"))),
    ],
    entry_points={
        "console_scripts": [
            "rpud = rpud_sim.cli.main:main",
            "drill_node = rpud_sim.cli.executables:drill_node",
            "recorder = rpud_sim.cli.executables:recorder",
            "replayer = rpud_sim.cli.executables:replayer",
        ],
        # Fixtures for tests with a drill, in every run of pytest where this package is installed.
        "pytest11": ["rpud_sim = rpud_sim.testing.plugin"],
    },
)
