"""The scene that save_blend left in Blender as USD: .usdz for phones and viewers, .usdc and .usda for programs."""

from __future__ import annotations

from pathlib import Path

from procmodels.blender import require, silenced

ENDINGS = (".usdz", ".usdc", ".usda")


def export_usd(path: Path) -> None:
    """Y up, as USD's viewers on phones take it; in metres, the materials as preview surfaces, parts by their names.

    Raises BlenderMissing, and OSError when the file cannot be written.
    """
    bpy = require("bpy")
    with silenced():
        try:
            bpy.ops.wm.usd_export(
                filepath=str(path),
                convert_orientation=True,
                export_global_forward_selection="NEGATIVE_Z",
                export_global_up_selection="Y",
                export_custom_properties=True,
                generate_preview_surface=True,
                export_materials=True,
                convert_world_material=False,
            )
        except RuntimeError as error:  # Blender's operators know no other kind
            raise OSError(f"{path}: {error}") from error
    if not path.is_file():  # the exporter reports some failures only to Blender's window
        raise OSError(f"{path}: Blender could not write it")
