"""Robot description of the drill, with the joints of the models that are on."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

# Joint and link of urdf/rpud_feed.urdf for each model.
_FEED = ("rpud_feed", "rpud_rail")
_ROTATION = ("rpud_rotation", "rpud_bit")


def robot_description(folder: Path, feed: bool = False, rotation: bool = False) -> str:
    """Return the URDF of the drill with the joints of the models that are on."""
    text = (folder / "rpud.urdf").read_text(encoding="utf-8")
    if not (feed or rotation):
        return text
    robot = ElementTree.fromstring(text)
    wanted = {*(_FEED if feed else ()), *(_ROTATION if rotation else ())}
    more = ElementTree.fromstring((folder / "rpud_feed.urdf").read_text(encoding="utf-8"))
    robot.extend(part for part in more if part.get("name") in wanted)
    return ElementTree.tostring(robot, encoding="unicode")
