"""The look of a shape from photos of the object: base colours of its parts and one texture."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

import numpy as np

from procmodels.look import Look
from procmodels.shape import Shape
from recon.appearance import fill
from recon.appearance.agreement import agreed
from recon.appearance.atlas import unwrapped
from recon.appearance.blend import Blend, blended
from recon.appearance.cell_images import CellImages
from recon.appearance.light import BRIGHT, believed, light
from recon.appearance.materials import alike, base_colours
from recon.appearance.texels import Texels
from recon.appearance.views import Rays, ViewOptions, views
from recon.scene import Scene

log = logging.getLogger("recon")


@dataclass(frozen=True)
class LookOptions:
    """How the look is made."""

    plain: bool = False  # no colours and no texture
    size: int = 2048  # px, side of the texture
    unshaded: bool = True  # take the light of the room out of the colours
    views: ViewOptions = field(default_factory=ViewOptions)


@dataclass(frozen=True)
class Appearance:
    """look is None when it was not asked for or no photo shows the shape; seen is the share of the surface that photos
    show.
    """

    look: Look | None
    seen: float = 0.0


def run(shape: Shape, scene: Scene, options: LookOptions = LookOptions()) -> Appearance:
    """Colour a shape where it stands in a scene. Raises InputError when a photo is gone."""
    if options.plain or not scene.silhouettes.used.any():
        return Appearance(None)
    atlas = unwrapped(shape, options.size)
    rays = Rays(atlas)
    shots = list(views(scene, atlas, rays, options.views))
    texels = Texels.of(atlas)
    cells = texels.cells()
    agreement = agreed(cells, atlas, shots) if shots else None
    if agreement is None or not (agreement.weight > 0).any():
        log.warning("no photo shows the shape where it stands: it gets no colours")
        return Appearance(None)
    images = CellImages(cells, texels)
    part = atlas.part[cells.triangle]
    shade, material = np.ones(len(cells.flat)), None
    if options.unshaded:
        material = alike(part, len(shape.parts), agreement.colour, agreement.weight)
        found = light(cells, atlas, rays, agreement.colour, agreement.weight, material)
        shade, material = found.shade, found.material
    base, factor = base_colours(shape.parts, part, agreement.colour / shade[:, None], agreement.weight, material)
    blend = blended(texels, atlas, shots, agreement, images)
    if options.unshaded:
        whole = factor @ BRIGHT
        shade = believed(shade / whole[part], agreement.colour @ BRIGHT, (base @ BRIGHT)[part])
        factor = factor / whole[:, None]
    lit = images.spread(shade[:, None]) / factor.astype(np.float32)[atlas.part[texels.triangle]]
    blend = Blend(blend.colour / lit, blend.known)
    colour = fill.filled(blend, texels, cells, atlas, images, base)
    look = Look(np.clip(base, 0, 1), fill.picture(texels, colour), atlas.uv)
    return Appearance(look, float((blend.known > fill.SEEN).mean()))
