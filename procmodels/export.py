"""Files for other programs, in the frames of procmodels.asset: .blend, GLB and OBJ. Only save_blend needs Blender."""

from procmodels.asset import Asset
from procmodels.blend_file import save_blend
from procmodels.glb import export_glb
from procmodels.obj import export_obj

__all__ = ["Asset", "export_glb", "export_obj", "save_blend"]
