"""The water of a job that its deck takes to be without error."""

from __future__ import annotations

import numpy as np

from musatpy.arrays import BoolArray
from musatpy.model import Block, Program, Refraction, Treatment, WaterLevel
from musatpy.model.solution import WAVE_VALUES
from musatpy.model.water import WAVE_SIGMAS

_NAMED = 8  # photos: of more, the first ones are named


def exact_water(block: Block) -> tuple[str, ...]:
    """Return, in words, what of the water is neither adjusted nor has a sigma; nothing without submerged points.

    A run without refraction knows of the water its level only.
    """
    options, water = block.options, block.water
    if water is None or not block.points.bathymetric.any():
        return ()
    tides = _exact_tides(block)
    exact = []
    if tides.any():
        every = not (block.photos.tide_sigma > 0.0).any() and options.water_level is WaterLevel.KNOWN
        exact.append("all tides" if every else f"the tides of photos {_named(block.photos.ids[tides].tolist())}")
    if options.program is Program.IIA and options.refraction is Refraction.NONE:
        return tuple(exact)
    if options.water_index is not Treatment.ADJUST and not water.sigma:
        exact.append("the refractive index")
    if options.water_tilt is not Treatment.ADJUST and not water.tilt_sigma:
        exact.append("the tilt of the surface")
    waves = block.waves
    for row, name in enumerate(waves.ids.tolist()):
        known = [
            parameter
            for parameter, sigma in zip(WAVE_VALUES, WAVE_SIGMAS, strict=True)
            if not getattr(waves, sigma)[row] > 0.0
        ]
        if known:
            exact.append(f"wave {name} ({', '.join(known)})")
    return tuple(exact)


def _exact_tides(block: Block) -> BoolArray:
    """Return (n,) the photos that show submerged points and whose tide has neither a sigma nor a correction."""
    photos, level = block.photos, block.options.water_level
    shown = np.zeros(len(photos.ids), dtype=bool)
    shown[block.plates.photo[block.points.bathymetric[block.plates.point]]] = True
    adjusted = np.zeros(len(photos.ids), dtype=bool)
    if block.options.program is Program.IIIA and level is not WaterLevel.KNOWN:
        labels = {WaterLevel.GROUP: photos.tide_group, WaterLevel.DAY: photos.tide_day}.get(level)
        adjusted = np.ones_like(adjusted) if labels is None else labels != ""
    return shown & np.isfinite(photos.tide) & ~adjusted & ~(photos.tide_sigma > 0.0)


def _named(ids: list[str]) -> str:
    more = len(ids) - _NAMED
    return ", ".join(ids[:_NAMED]) + (f" and {more} others" if more > 0 else "")
