"""From a block to the network of its adjustment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds import MEASURED, UNKNOWNS
from musatpy.adjustment.network import (
    Border,
    GroundPriors,
    Network,
    Participation,
    group_points,
    inverse_squares,
)
from musatpy.adjustment.pattern import Pattern
from musatpy.adjustment.water_surface import water_knowledge
from musatpy.adjustment.wavy_water import Sea, WorkingSea
from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.frames import Frame
from musatpy.model import Block, CoordinateSystem, PointStatus


def build_network(block: Block, frame: Frame, part: Participation, sea: Sea | None = None) -> Network:
    """Return the network of a block, with the measured plate coordinates and straight rays."""
    photos, plates = block.photos, block.plates
    position = frame.working(photos.position)
    priors = _ground_priors(block, frame, part.status == PointStatus.TRIANGULATED)
    by_collinearity = priors.known.any(axis=1) | (priors.group >= 0)
    enters = part.status == PointStatus.TRIANGULATED
    kept = np.unique(np.concatenate([kind.ends(block, enters).reshape(-1) for kind in MEASURED]))
    measured = {kind.observed: kind.measured(block, enters) for kind in MEASURED}
    eliminated = enters.copy()
    eliminated[kept] = False
    pass_groups = group_points(plates.photo, plates.point, part.used, eliminated & ~by_collinearity)
    control_groups = tuple(
        replace(group, known=True)
        for group in group_points(plates.photo, plates.point, part.used, eliminated & by_collinearity)
    )
    left_out = group_points(
        plates.photo, plates.point, np.ones_like(part.used), part.status == PointStatus.INTERSECTED
    )
    together = [plates.photo[group.rays] for group in (*pass_groups, *control_groups, *left_out)]
    water = water_knowledge(block)
    return Network(
        frame=frame,
        position=position,
        attitude=photos.attitude,
        axes=frame.axes(position),
        position_weight=inverse_squares(photos.position_sigma),
        attitude_weight=inverse_squares(photos.attitude_sigma),
        focal_length=block.cameras.focal_length[photos.camera],
        principal_point=block.cameras.principal_point[photos.camera],
        water=water,
        sea=None if sea is None else WorkingSea.of(sea, frame),
        tilt_axes=np.asarray(frame.axes(np.zeros(3)))[:2],
        photo=plates.photo,
        point=plates.point,
        xy=plates.xy,
        weight=inverse_squares(block.plate_sigmas),
        refracted=np.zeros(len(plates.photo), dtype=bool),
        priors=priors,
        border=Border(
            columns={kind.observed: tuple(kind.names(block, water, sea)) for kind in UNKNOWNS}, kept=kept
        ),
        pass_groups=pass_groups,
        control_groups=control_groups,
        kept_groups=tuple(
            replace(group, kept=True, known=True)
            for group in group_points(plates.photo, plates.point, part.used, enters & ~eliminated)
        ),
        measured=measured,
        pattern=Pattern.of(
            len(photos.ids),
            7 if water.per_photo else 6,
            [*together, *(of.photo for of in measured.values() if of.photo.shape[1] > 1)],
            position if np.isfinite(position).all() else None,
        ),
    )


def _ground_priors(block: Block, frame: Frame, enters: BoolArray) -> GroundPriors:
    control, groups, p = block.control, block.equal_elevations, len(block.points.ids)
    given = np.full((p, 3), np.nan)
    given[control.point] = _level_coordinates(block, frame)
    known = np.zeros((p, 3), dtype=bool)
    known[control.point] = control.known & enters[control.point][:, None]
    held = np.zeros((p, 3), dtype=bool)
    held[control.point] = known[control.point] & control.fixed[:, None]
    weight = np.zeros((p, 3))
    weight[control.point] = inverse_squares(control.sigma)
    group, group_weight = np.full(p, -1), np.zeros(p)
    member = enters[groups.point]
    group[groups.point[member]] = groups.group[member]
    group_weight[groups.point[member]] = inverse_squares(groups.sigma)[groups.group[member]]
    return GroundPriors(
        given=given,
        known=known,
        held=held,
        weight=np.where(known & ~held, weight, 0.0),
        group=group,
        group_weight=group_weight,
    )


def _level_coordinates(block: Block, frame: Frame) -> FloatArray:
    """Return control in level coordinates (k, 3); geocentric control must be complete to have any."""
    position = block.control.position
    if block.options.system is CoordinateSystem.GEOCENTRIC:
        level = np.full(position.shape, np.nan)
        complete = ~np.isnan(position).any(axis=1)
        level[complete] = frame.level(frame.working(position[complete]))
        return level
    return position
