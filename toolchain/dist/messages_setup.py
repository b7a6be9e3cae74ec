"""Pack the staged ``rpud_msgs`` as a wheel: the setup.py of the folder that messages.py writes."""

from collections import defaultdict
from pathlib import Path
from xml.etree import ElementTree

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel

manifest = ElementTree.parse("package.xml").getroot()
data_files = defaultdict(list)
for place in ("lib", "share"):
    for file in sorted(Path(place).rglob("*")):
        if file.is_file():
            data_files[str(file.parent)].append(str(file))


class CompiledDistribution(Distribution):
    """Distribution that is not the same for every Python, although setuptools compiles nothing."""

    def has_ext_modules(self) -> bool:
        """Return True: the modules are here already."""
        return True


class TaggedWheel(bdist_wheel):
    """Wheel whose tag names every CPython that it has a module for."""

    def get_tag(self) -> tuple[str, str, str]:
        """Return the tag that the modules were compiled for."""
        python, abi, platform = Path("tag").read_text().split("-")
        return python, abi, platform


setup(
    name="rpud_msgs",
    version=manifest.findtext("version"),
    description=manifest.findtext("description"),
    long_description=f"{manifest.findtext('description')} The package rpud_sim publishes them.",
    long_description_content_type="text/plain",
    url=manifest.findtext("url"),
    license_expression=manifest.findtext("license"),
    license_files=["LICENSE"],
    maintainer=manifest.findtext("maintainer"),
    maintainer_email=manifest.find("maintainer").get("email"),
    packages=["rpud_msgs", "rpud_msgs.msg", "rpud_msgs.srv"],
    package_data={"rpud_msgs": ["*.so"]},
    data_files=list(data_files.items()),
    python_requires=">=3.10,<3.14",
    # Versions whose messages these were compiled with.
    install_requires=[
        "numpy",
        "ros-jazzy-builtin-interfaces==2.0.3",
        "ros-jazzy-std-msgs==5.3.6",
        "ros-service-msgs~=2.0.3",
    ],
    distclass=CompiledDistribution,
    cmdclass={"bdist_wheel": TaggedWheel},
)
