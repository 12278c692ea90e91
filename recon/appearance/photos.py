"""The look of a shape from photos of the object: base colours of its parts and one texture."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

import numpy as np

from procmodels.look import Look
from procmodels.shape import Shape
from recon.appearance import fill
from recon.appearance.agreement import Agreement, agreed
from recon.appearance.atlas import Atlas, unwrapped
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
    base, shade, tint = _unlit(shape, atlas, rays, cells, agreement, options)
    blend = blended(texels, atlas, shots, agreement, images)
    lit = images.spread(shade[:, None]) * tint.astype(np.float32)[atlas.part[texels.triangle]]
    blend = Blend(blend.colour / lit, blend.known)
    colour = fill.filled(blend, texels, cells, atlas, images, base)
    look = Look(np.clip(base, 0, 1), fill.picture(texels, colour), atlas.uv)
    return Appearance(look, float((blend.known > fill.SEEN).mean()))


def _unlit(
    shape: Shape, atlas: Atlas, rays: Rays, cells: Texels, agreement: Agreement, options: LookOptions
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Base colours (P, 3) of the parts; and the light at every cell (m,) and its tint on every part (P, 3), by which
    the photos' colours are divided.
    """
    part, colour, weight = atlas.part[cells.triangle], agreement.colour, agreement.weight
    if not options.unshaded:
        base, _ = base_colours(shape.parts, part, colour, weight)
        return base, np.ones(len(part)), np.ones_like(base)
    found = light(cells, atlas, rays, colour, weight, alike(part, len(shape.parts), colour, weight))
    base, factor = base_colours(shape.parts, part, colour / found.shade[:, None], weight, found.material)
    whole = factor @ BRIGHT
    shade = believed(found.shade / whole[part], colour @ BRIGHT, (base @ BRIGHT)[part])
    return base, shade, whole[:, None] / factor
