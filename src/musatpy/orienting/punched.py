"""The block to go on with, from an orientation: stations, attitudes, tides and tilt from which a run starts."""

from __future__ import annotations

from dataclasses import replace

from musatpy.model import (
    Block,
    Control,
    CoordinateSystem,
    Datum,
    Initial,
    Options,
    PlaneTreatment,
    Program,
    Refraction,
    Treatment,
    WaterLevel,
)
from musatpy.model.block import in_order
from musatpy.model.tables import empty
from musatpy.orienting.placement import Placement


def punched(answer: Placement) -> Block:
    """Return the block that IIIA adjusts from what was found, with the same of the water unknown.

    Of a model it is a free network in its axes, without the control, which stands in others.
    """
    scene, block = answer.scene, answer.block
    photos, water = block.photos, block.water
    position, attitude, tide = photos.position.copy(), photos.attitude.copy(), photos.tide.copy()
    position[scene.photos], attitude[scene.photos] = answer.position, answer.attitude
    # the tilt of a deck turns about the middle of the stations
    middle = answer.at.station[:, :2].mean(axis=0)
    rise = 0.0 if scene.plane.rise is None else scene.plane.rise
    slope = answer.at.slope
    tide[scene.photos] = float(answer.at.level) + middle @ slope + rise
    if answer.scene.dry:
        tide = photos.tide
    tilted = scene.spec.plane is PlaneTreatment.ADJUST or slope.any()
    east, north = (float(part) if tilted else None for part in slope)
    result = replace(
        block,
        options=_options(answer),
        orientation=None,
        photos=replace(photos, position=position, attitude=attitude, tide=tide),
        water=water if answer.scene.dry or water is None else replace(water, tilt_east=east, tilt_north=north),
    )
    if not scene.in_model:
        return result
    return in_order(replace(result, ellipsoid=None, control=empty(Control), given_in=None, stated_in=None))


def _options(answer: Placement) -> Options:
    """Return the options by which a run solves the same problem."""
    plane, in_model = answer.scene.spec.plane, answer.scene.in_model
    options = answer.block.options
    return replace(
        options,
        program=Program.IIIA,
        refraction=Refraction.RIGOROUS,
        system=CoordinateSystem.LOCAL if in_model else options.system,
        initial=Initial.GIVEN,
        water_level=WaterLevel.KNOWN if plane is PlaneTreatment.KNOWN else WaterLevel.ONE,
        water_tilt=Treatment.ADJUST if plane is PlaneTreatment.ADJUST else Treatment.KNOWN,
        datum=Datum.FREE if in_model else Datum.CONTROL,
    )
