"""Install rpud_sim, in a ROS 2 workspace (colcon) or as a plain Python package (pip)."""

from glob import glob
from xml.etree import ElementTree

from setuptools import find_packages, setup

PACKAGE = "rpud_sim"
manifest = ElementTree.parse("package.xml").getroot()

setup(
    name=PACKAGE,
    version=manifest.findtext("version"),
    description=" ".join(manifest.findtext("description").split()),
    license=manifest.findtext("license"),
    maintainer=manifest.findtext("maintainer"),
    maintainer_email=manifest.find("maintainer").get("email"),
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={PACKAGE: ["py.typed"], f"{PACKAGE}.bag": ["share/*/msg/*.msg"]},
    python_requires=">=3.10",
    # What the offline commands need. The ROS packages come from package.xml.
    install_requires=[
        "apsw",
        "jinja2",
        "lz4",
        "matplotlib",
        "mcap",
        "numba",
        "numpy",
        "pyarrow",
        "pyyaml",
        "rosbags",
        "scipy",
        "tqdm",
        "zstandard",
    ],
    extras_require={
        "cluster": ["distributed"],
        "test": [
            "distributed",
            "hypothesis",
            "mcap-ros2-support",
            "pytest",
            "pytest-timeout",
            "pytest-xdist",
        ],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        (f"share/{PACKAGE}/launch", sorted(glob("launch/*.launch.py"))),
        (f"share/{PACKAGE}/config", sorted(glob("config/*"))),
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
