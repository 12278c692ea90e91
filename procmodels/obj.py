"""Wavefront OBJ of an asset, with its material library and picture beside it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from procmodels.asset import Y_UP_FROM_Z_UP, Asset
from procmodels.look import encoded, srgb
from procmodels.shape import Part

PICTURE = "texture.jpg"  # beside the OBJ file


def export_obj(asset: Asset, path: Path, world: bool = False, up: str = "y") -> None:
    """A Wavefront OBJ with the polygons kept and one object a part.

    up     "y", which readers assume, or "z": the axis that points up; the object stands on 0 of it
    world  in the frame of the photos' cameras instead (SfM units, no preferred up)
    The colours of a look go into an MTL file of the same name, its picture beside it; not for the world's mesh.
    """
    lines = [f"# {asset.space.name}"]
    look = None if world else asset.look
    if world:
        if asset.world_from_canonical is None:
            raise ValueError("there is no world frame: world_from_canonical is None")
        matrix = asset.world_from_canonical
        lines.append("# frame: the world of the cameras beside this file; SfM units; no preferred up axis")
    else:
        matrix = (Y_UP_FROM_Z_UP if up == "y" else np.eye(4)) @ asset.mesh_from_canonical
        told = "faces +Z, Y up, standing on y = 0" if up == "y" else "faces -Y, Z up, standing on z = 0"
        lines.append(f"# axes: right-handed, X right, object {told}; unit: {asset.unit}")
    lines += [f"# {name} = {value}" for name, value in asset.params.items()]
    if look:
        lines.append(f"mtllib {path.with_suffix('.mtl').name}")
        _write_materials(asset, path)
    start, corner = 1, 1  # OBJ counts from 1, over all objects
    for i, part in enumerate(asset.shape.parts):
        lines.append(f"o {_name(part)}")
        lines += [f"v {x:.7g} {y:.7g} {z:.7g}" for x, y, z in part.moved(matrix).vertices]
        with_uv = look is not None and bool(look.uv)
        if look:
            lines += [f"vt {u:.6f} {v:.6f}" for u, v in look.uv[i]] if with_uv else []
            lines.append(f"usemtl {_name(part)}")
        for face in part.faces:
            after = [f"/{corner + k}" if with_uv else "" for k in range(len(face))]
            lines.append("f " + " ".join(f"{start + v}{vt}" for v, vt in zip(face, after, strict=True)))
            corner += len(face)
        start += len(part.vertices)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _name(part: Part) -> str:
    return part.name.replace(" ", "_")  # many readers end a name at a space


def _write_materials(asset: Asset, path: Path) -> None:
    """The MTL file beside the OBJ file `path`, and the picture. Colours are sRGB, as viewers take them."""
    picture = asset.look.picture if asset.look else None
    lines = [f"# {asset.space.name}"]
    for part, colour in zip(asset.shape.parts, srgb(asset.colours), strict=True):
        told = " ".join(f"{c:.4f}" for c in colour)
        lines += [f"newmtl {_name(part)}", "Ks 0.04 0.04 0.04", "Ns 60", "illum 2"]
        # Readers multiply the picture by Kd.
        lines += [f"Kd {told}"] if picture is None else [f"# mean {told}", "Kd 1 1 1", f"map_Kd {PICTURE}"]
    path.with_suffix(".mtl").write_text("\n".join(lines) + "\n", encoding="utf-8")
    if picture is not None:
        path.with_name(PICTURE).write_bytes(encoded(picture))
