"""What people call the columns and arrays that hold points."""

from __future__ import annotations

import re

POINTS = {
    "points",
    "point",
    "xyz",
    "positions",
    "position",
    "pos",
    "vertices",
    "verts",
    "coords",
    "coordinates",
    "coord",
}
POINTS |= {"pc", "pcd", "cloud", "point_cloud", "pointcloud", "pts", "v", "p"}
COLOURS = {
    "colors",
    "colours",
    "color",
    "colour",
    "rgb",
    "rgba",
    "normals",
    "normal",
    "labels",
    "label",
    "intensity",
    "uv",
}
_AXES = (
    r"(?:pos|position|point|points|coord|coordinate|p|vertex)?[_:. ]*{}",
    r"{}[_:. ]*(?:pos|position|coord|coordinate|value)?(?:[_ ]?(?:mm|cm|m|in|inch))?",
)
_OTHER = ({"points:0", "points_0", "easting", "east", "e"}, {"points:1", "points_1", "northing", "north", "n"})
_HEIGHT = {"points:2", "points_2", "elevation", "height", "altitude", "h"}


def axis_columns(names: list[str]) -> tuple[int, int, int] | None:
    """Which of the columns named so are x, y and z; None when one is missing or there twice.

    Units in brackets, quotes and signs of comments around the names are passed over.
    """
    plain = [re.sub(r"[\[(].*?[\])]", "", name).strip(" \t\"'#/%;").lower() for name in names]
    found = []
    for axis, other in zip("xyz", (*_OTHER, _HEIGHT), strict=True):
        mine = [i for i, name in enumerate(plain) if name == axis]
        mine = mine or [i for i, name in enumerate(plain) if any(re.fullmatch(p.format(axis), name) for p in _AXES)]
        mine = mine or [i for i, name in enumerate(plain) if name in other]
        if len(mine) != 1:
            return None
        found.append(mine[0])
    return found[0], found[1], found[2]
