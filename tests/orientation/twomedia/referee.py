"""The same images as a block of program IIIA: the independent solution that the methods are held against."""

from dataclasses import replace

import numpy as np

from musatpy import model
from musatpy.geometry.geodesy import middle_of
from musatpy.model.tables import taken
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orientation.twomedia.sights import Sights
from musatpy.units import ARC_SECOND
from orientation.flights import fly
from orientation.twomedia.geometries import Scene


def block_of(scene: Scene, sights: Sights, start: Orientation) -> model.Block:
    """Return the block of a scene: IIIA, level and tilt of the water unknown, started at an orientation."""
    m = len(sights.photos)
    bare = fly(np.tile([0.0, 0.0, 3000.0], (3, 1)), np.zeros((3, 3)), control=1).block
    f = 1000.0 * scene.kind.c
    known = np.flatnonzero(sights.is_control)
    return replace(
        bare,
        options=model.Options(
            program=model.Program.IIIA,
            system=model.CoordinateSystem.LOCAL,
            refraction=model.Refraction.RIGOROUS,
            water_level=model.WaterLevel.ONE,
            water_tilt=model.Treatment.ADJUST,
            plate_sigma=f * float(sights.image_sigma[0, 0]),
            max_iterations=60,
            rotation_limit=1e-7 * ARC_SECOND,
            translation_limit=1e-12 * scene.kind.H,
        ),
        water=model.Water(index=float(start.index)),
        cameras=replace(bare.cameras, focal_length=np.array([f]), format_size=np.full((1, 2), 5 * f)),
        photos=replace(
            taken(bare.photos, np.arange(m) % 3),
            ids=np.array([str(photo) for photo in range(m)]),
            position=start.station,
            attitude=start.attitude,
            tide=np.full(m, float(start.level + start.station[:, :2].mean(axis=0) @ start.slope)),
        ),
        points=model.Points(ids=sights.points, bathymetric=sights.wet),
        plates=replace(
            bare.plates,
            photo=sights.photo,
            point=sights.point,
            xy=f * sights.image,
            sigma=f * sights.image_sigma,
            triangulated=np.ones(len(sights.photo), dtype=bool),
        ),
        control=replace(
            bare.control,
            point=known,
            kind=np.full(len(known), model.ControlKind.FULL),
            fixed=(sights.control_sigma[known] == 0.0).all(axis=1),
            position=sights.control[known],
            sigma=np.where(sights.control_sigma[known] > 0.0, sights.control_sigma[known], np.nan),
        ),
    )


def level_of_origin(solution: model.Solution) -> float:
    """Return the level of the water at (0, 0): its tides hold at the origin of the axes of the adjustment."""
    assert solution.water is not None
    origin = middle_of(solution.block.photos.position)
    return float(solution.water.tide[0] - origin[:2] @ solution.water.tilt)
