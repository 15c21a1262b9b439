"""Decks of the geometries of Okamoto and Mori (1974), of a laboratory in centimetres and from the air in metres."""

from dataclasses import replace

import numpy as np

from musatpy import model
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Sights
from orientation.twomedia.geometries import (
    KINDS,
    Scene,
    block_of,
    corners,
    geometry,
    sights_of,
    strip_scene,
    strip_sights,
    strip_truth,
    truth_of,
)

UNITS = {"lab": 100.0, "tank": 100.0, "aerial": 1.0}  # of the deck, in a metre


def scaled(at: Orientation, unit: float) -> Orientation:
    """Return an orientation in the units of a deck."""
    return replace(at, station=unit * at.station, level=unit * at.level)


def deck_block(
    name: str,
    method: str,
    control: int,
    *,
    noise: float = 5e-6,
    seed: int = 1,
    true: Scene | None = None,
    **card: object,
) -> tuple[model.Block, Orientation, Scene]:
    """Return the block of a deck that says nothing of stations and tides, the truth, and the scene."""
    scene, unit = true or geometry(name, method), UNITS[name]
    sights: Sights = sights_of(scene, control, control_sigma=1e-5 * scene.kind.H)
    error = np.random.default_rng(seed).normal(size=sights.image.shape) * noise / scene.kind.c
    sights = replace(sights, image=sights.image + error, control=unit * sights.control)
    sights = replace(sights, control_sigma=unit * sights.control_sigma)
    spec = model.OrientationSpec(method=model.OrientationMethod(method), **card)  # type: ignore[arg-type]
    return _bare(scene, sights, truth_of(scene)[0], spec), scaled(truth_of(scene), unit), scene


def strip_block(
    name: str, photos: int, *, control: bool = True, noise: float = 1.0, seed: int = 1, **card: object
) -> tuple[model.Block, Scene]:
    """Return the block of a deck of a strip over level water, errors of `noise` sigmas, and the scene.

    The tide is on it where the plane is KNOWN.
    """
    scene, unit = strip_scene(name, photos), UNITS[name]
    sights, _ = strip_sights(scene, noise, seed, corners(scene) if control else None)
    sights = replace(sights, control=unit * sights.control, control_sigma=unit * sights.control_sigma)
    spec = model.OrientationSpec(method=model.OrientationMethod.STRIP, **card)  # type: ignore[arg-type]
    block = _bare(scene, sights, strip_truth(scene)[0], spec)
    if spec.plane is model.PlaneTreatment.KNOWN:
        block = replace(block, photos=replace(block.photos, tide=np.full(photos, unit * scene.d)))
    return block, scene


def _bare(scene: Scene, sights: Sights, start: Orientation, spec: model.OrientationSpec) -> model.Block:
    """Return a block that says nothing of stations and tides."""
    block = block_of(scene, sights, start)
    photos = block.photos
    nothing = np.full(photos.position.shape, np.nan)
    return replace(
        block,
        titles=(f"{next(name for name in UNITS if KINDS[name] is scene.kind)} {spec.method}".upper(),),
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
