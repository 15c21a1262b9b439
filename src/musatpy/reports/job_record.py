"""The tables of the record that say what the deck was: options, ellipsoid, water, cameras, marks, plates."""

from __future__ import annotations

from musatpy.model import (
    Block,
    ComparatorSpec,
    CoordinateSystem,
    Datum,
    Editing,
    EllipsoidSpec,
    Initial,
    Options,
    Order,
    PlateSigma,
    Program,
    Refraction,
    Treatment,
    Water,
    WaterConditions,
    WaterLevel,
    Weights,
)
from musatpy.reports.fields import Field, Group, Rows
from musatpy.statistics import Statistics

OfBlock = Rows[Statistics, Block]


def _block(statistics: Statistics) -> Block:
    return statistics.block


def _read(statistics: Statistics) -> Block:
    return statistics.read


OPTIONS = Group[Statistics, Options](
    "options",
    "the option card",
    lambda s: s.block.options,
    (
        Field("program", "string", "adjustment program", choices=Program),
        Field("system", "string", "coordinate system", choices=CoordinateSystem),
        Field("initial", "string", "where the first stations and attitudes come from", choices=Initial),
        Field("refraction", "string", "treatment of submerged points", choices=Refraction),
        Field("weights", "string", "weights of the conditions", choices=Weights),
        Field("max_iterations", "integer", "iterations of one triangulation, at most"),
        Field("max_passes", "integer", "passes of the water point correction, at most"),
        Field("rotation_limit", "number", "largest differential rotation of a converged run", unit="rad"),
        Field("translation_limit", "number", "largest differential translation of a converged run", unit="m"),
        Field("water_limit", "number", "movement of submerged points that ends the passes", unit="m"),
        Field("plate_sigma", "number", "sigma of plate coordinates that have none of their own", unit="mm"),
        Field("submerged_factor", "number", "factor on the plate sigmas of submerged points"),
        Field("water_level", "string", "whose tides share an unknown correction", choices=WaterLevel),
        Field("water_tilt", "string", "tilt of the water surface", choices=Treatment),
        Field("water_index", "string", "refractive index", choices=Treatment),
        Field("datum", "string", "what holds the block as a whole", choices=Datum),
        Field("editing", "string", "what is done about blunders", choices=Editing),
        Field("order", "string", "order of the rows of stations, points, control and residuals", choices=Order),
        Field("plate_sigma_is", "string", "whether plate sigmas are as given, or estimated", choices=PlateSigma),
        Field("sigma0_limit", "number", "sigma0 from which a run is rejected"),
        Field("station_limit", "number",
              "flying heights between adjusted and given stations, from which a run is doubtful"),
    ),
)  # fmt: skip

ELLIPSOID = Group[Statistics, EllipsoidSpec](
    "ellipsoid",
    "null in local jobs",
    lambda s: s.block.ellipsoid,
    (
        Field("name", "string?", "PROJ name", lambda e: e.name or None),
        Field("semi_major_axis", "number?", "where there is no name", unit="m"),
        Field("inverse_flattening", "number?", "where there is no name"),
    ),
    optional=True,
)

_PARTS = "parts per thousand"
_CONDITIONS = Group[Water, WaterConditions](
    "conditions",
    "what the index is computed from; null where the deck gives the index itself",
    lambda water: water.conditions,
    (
        Field("temperature", "number", "of the water", unit="degC"),
        Field("wavelength", "number", "of the light, in vacuum", unit="nm"),
        Field("salinity", "number?", "of the water; null where its chlorinity is given", unit=_PARTS),
        Field("chlorinity", "number?", "of the water; null where its salinity is given", unit=_PARTS),
        Field("formula", "string", "of the index; empty is QUANFRY", choices=("", "QUANFRY", "IAPWS")),
        Field("air_temperature", "number?", "null is 15", unit="degC"),
        Field("air_pressure", "number?", "null is 101325", unit="Pa"),
    ),
    optional=True,
)
WATER = Group[Statistics, Water](
    "water",
    "null without a water card",
    lambda s: s.block.water,
    (
        Field("index", "number", "refractive index relative to air"),
        Field("sigma", "number?", "of the index"),
        Field("liquid", "string", "its name; empty is water"),
        Field("tilt_east", "number?", "slope of the surface towards east; null is level", unit="rad"),
        Field("tilt_north", "number?", "slope towards north", unit="rad"),
        Field("tilt_sigma", "number?", "of both slopes", unit="rad"),
        _CONDITIONS,
    ),
    optional=True,
)

CAMERAS = OfBlock(
    "cameras",
    "one row per camera",
    _block,
    (
        Field("camera", "string", "camera id", lambda b: b.cameras.ids),
        Field("focal_length", "number", "calibrated", lambda b: b.cameras.focal_length, "mm"),
        Field("principal_point", "2 number", "xp, yp", lambda b: b.cameras.principal_point, "mm", exact=True),
        Field("format_size", "2 number?", "x, y", lambda b: b.cameras.format_size, "mm"),
    ),
)
DISTORTION = OfBlock(
    "distortion",
    "one row per distortion card",
    _block,
    (
        Field("camera", "string", "camera id", lambda b: b.cameras.ids[b.distortion.camera]),
        Field("kind", "string", "radial, decentring or tabulated", lambda b: b.distortion.kind,
              choices=("RADL", "DCEN", "TABL")),
        Field("values", "3 number?", "K1 K2 K3 (for r in mm), P1 P2 P3, or radius and distortion (mm)",
              lambda b: b.distortion.values),
    ),
)  # fmt: skip
FIDUCIALS = OfBlock(
    "fiducials",
    "one row per calibrated mark",
    _block,
    (
        Field("camera", "string", "camera id", lambda b: b.cameras.ids[b.fiducials.camera]),
        Field("mark", "string", "id of the mark", lambda b: b.fiducials.ids),
        Field("xy", "2 number", "calibrated", lambda b: b.fiducials.xy, "mm", exact=True),
        Field("sigma", "2 number?", "of xy", lambda b: b.fiducials.sigma, "mm"),
    ),
)
FIDUCIAL_MEASUREMENTS = OfBlock(
    "fiducial_measurements",
    "one row per measured mark",
    _read,
    (
        Field("photo", "string", "photo id", lambda b: b.photos.ids[b.fiducial_measurements.photo]),
        Field("mark", "string", "id of the mark", lambda b: b.fiducial_measurements.ids),
        Field("xy", "2 number", "measured", lambda b: b.fiducial_measurements.xy, "mm", exact=True),
        Field("sigma", "2 number?", "of xy", lambda b: b.fiducial_measurements.sigma, "mm"),
    ),
    of_images=True,
)

COMPARATOR = Group[Statistics, ComparatorSpec](
    "comparator",
    "the comparator of raw plates, null without card; `unit` is that of its readings",
    lambda s: s.read.comparator,
    (
        Field("scale_u", "number", "of the first rail", unit="mm/unit"),
        Field("scale_v", "number", "of the second rail", unit="mm/unit"),
        Field("non_orthogonality", "number", "by which the second rail leans towards the first", unit="rad"),
        Field("rotation", "number", "of the readings, counter-clockwise", unit="rad"),
        Field("left_handed", "boolean", "the second rail is reversed"),
        Field("reading_sigma", "number", "standard deviation of one reading", unit="unit"),
        Field("repeat_limit", "number?", "of the deviation of repeated readings from their mean", unit="unit"),
    ),
    optional=True,
)
LENSES = OfBlock(
    "lenses",
    "one row per lens card",
    _read,
    (
        Field("camera", "string", "camera id", lambda b: b.cameras.ids[b.lenses.camera]),
        Field("centre", "2 number?", "principal point of best symmetry", lambda b: b.lenses.centre, "mm",
              exact=True),
        Field("k0", "number?", "linear coefficient of the radial distortion, as on the card",
              lambda b: b.lenses.k0),
    ),
)  # fmt: skip
MARK_DISTANCES = OfBlock(
    "mark_distances",
    "one row per calibrated distance between fiducial marks",
    _read,
    (
        Field("camera", "string", "camera id", lambda b: b.cameras.ids[b.mark_distances.camera]),
        Field("marks", "2 string", "mark ids", lambda b: b.mark_distances.marks),
        Field("distance", "number", "calibrated", lambda b: b.mark_distances.distance, "mm"),
        Field("sigma", "number", "of the distance", lambda b: b.mark_distances.sigma, "mm"),
        Field("axis", "string", "X, Y, D1, D2, or empty", lambda b: b.mark_distances.axis),
    ),
)
RESEAU = OfBlock(
    "reseau",
    "one row per calibrated reseau cross",
    _read,
    (
        Field("camera", "string", "camera id", lambda b: b.cameras.ids[b.reseau.camera]),
        Field("cross", "string", "cross id", lambda b: b.reseau.ids),
        Field("row", "integer", "in the grid, from 1", lambda b: b.reseau.row.astype(int)),
        Field("column", "integer", "in the grid, from 1", lambda b: b.reseau.column.astype(int)),
        Field("xy", "2 number", "calibrated", lambda b: b.reseau.xy, "mm", exact=True),
    ),
)
CROSS_MEASUREMENTS = OfBlock(
    "cross_measurements",
    "one row per reading of a reseau cross",
    _read,
    (
        Field("photo", "string", "photo id", lambda b: b.photos.ids[b.cross_measurements.photo]),
        Field("cross", "string", "cross id", lambda b: b.cross_measurements.ids),
        Field("xy", "2 number", "reading", lambda b: b.cross_measurements.xy, "unit", exact=True),
    ),
    of_images=True,
)
