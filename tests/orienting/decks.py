"""Decks of the geometries of Okamoto and Mori (1974), of a laboratory in centimetres and from the air in metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy import model
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Sights
from orientation.twomedia.geometries import Scene, geometry, sights_of, truth_of
from orientation.twomedia.referee import block_of

UNITS = {"lab": 100.0, "tank": 100.0, "aerial": 1.0}  # of the deck, in a metre


def scaled(at: Orientation, unit: float) -> Orientation:
    """Return an orientation in the units of a deck."""
    return replace(at, station=unit * at.station, level=unit * at.level)


def deck_block(
    name: str, method: str, control: int, *, noise: float = 5e-6, seed: int = 1, **card: object
) -> tuple[model.Block, Orientation, Scene]:
    """Return the block of a deck that says nothing of stations and tides, the truth, and the scene."""
    scene, unit = geometry(name, method), UNITS[name]
    sights: Sights = sights_of(scene, control, control_sigma=1e-5 * scene.kind.H)
    error = np.random.default_rng(seed).normal(size=sights.image.shape) * noise / scene.kind.c
    sights = replace(sights, image=sights.image + error, control=unit * sights.control)
    sights = replace(sights, control_sigma=unit * sights.control_sigma)
    block = block_of(scene, sights, truth_of(scene)[0])
    photos = block.photos
    nothing = np.full(photos.position.shape, np.nan)
    spec = model.OrientationSpec(method=model.OrientationMethod(method), **card)  # type: ignore[arg-type]
    block = replace(
        block,
        titles=(f"{name} {method}".upper(),),
        photos=replace(photos, position=nothing, attitude=nothing, tide=nothing[:, 0]),
        options=replace(
            block.options,
            water_level=model.WaterLevel.KNOWN,
            water_tilt=model.Treatment.KNOWN,
            rotation_limit=1e-8,
            translation_limit=1e-6,
        ),
        orientation=spec,
    )
    return block, scaled(truth_of(scene), unit), scene
