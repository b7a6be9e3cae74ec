"""Install rpud_sim, in a ROS 2 workspace (colcon) or as a plain Python package (pip)."""

import re
from glob import glob
from pathlib import Path
from xml.etree import ElementTree

from setuptools import __version__ as version
from setuptools import find_packages, setup

PACKAGE = "rpud_sim"
manifest = ElementTree.parse("package.xml").getroot()
VERSION = manifest.findtext("version")
URL = manifest.findtext("url")
# Ubuntu's setuptools does not know the later form.
LICENSE = "license_expression" if int(version.partition(".")[0]) >= 77 else "license"
readme = Path("README.md")  # colcon links only to the package
# Outside of the repository a relative link leads nowhere; a picture needs the address of its file.
README = readme.read_text(encoding="utf-8") if readme.exists() else ""
for start, place in ((r"(?<!!)\[[^]]*\]\(", "blob"), (r'!\[[^]]*\]\(|src="|srcset="', "raw")):
    README = re.sub(rf"({start})(?!https?:|#)", rf"\1{URL}/{place}/main/", README)

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
WEB = ["matplotlib>=3.7", "scipy", "tornado"]
EXPORT = ["pyarrow"]

setup(
    name=PACKAGE,
    version=VERSION,
    description=" ".join(manifest.findtext("description").split()),
    long_description=README,
    long_description_content_type="text/markdown",
    url=URL,
    project_urls={
        "Changelog": f"{URL}/blob/main/CHANGELOG.rst",
        "Documentation": f"{URL}/tree/main/docs",
    },
    **{LICENSE: manifest.findtext("license")},
    license_files=[
        name
        for name in ("LICENSE", f"{PACKAGE}/viewer/share/vendor/LICENSE")
        if Path(name).exists()
    ],
    classifiers=[
        "Development Status :: 4 - Beta",
        "Intended Audience :: Science/Research",
        "Operating System :: POSIX :: Linux",
        *(f"Programming Language :: Python :: 3.{minor}" for minor in (10, 11, 12, 13)),
        "Topic :: Scientific/Engineering :: Physics",
        "Typing :: Typed",
    ],
    maintainer=manifest.findtext("maintainer"),
    maintainer_email=manifest.find("maintainer").get("email"),
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: ["py.typed"],
        f"{PACKAGE}.messages": ["share/*/msg/*.msg"],
        f"{PACKAGE}.kernels": ["compiled/*.kernel"],
        f"{PACKAGE}.pages": ["share/*.css"],
        f"{PACKAGE}.viewer": ["share/*", "share/vendor/*"],
    },
    python_requires=">=3.10,<3.14",
    # What every command needs. Where an extra is missing, the program says which.
    install_requires=[
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
        "export": EXPORT,
        "studies": ["matplotlib>=3.7", "pandas", *EXPORT],  # sweep
        # What the plugin and campaigns need: each leaves a page.
        "test": ["pytest>=8", *WEB],
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
