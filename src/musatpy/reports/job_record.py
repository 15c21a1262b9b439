"""The tables of the record that say what the deck was: options, ellipsoid, water, cameras, marks, plates."""

from __future__ import annotations

from musatpy.model import Block, ComparatorSpec, EllipsoidSpec, Options, Water, WaterConditions
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
        Field("program", "string", "adjustment program", lambda o: o.program, choices=("IIA", "IIIA")),
        Field("system", "string", "coordinate system", lambda o: o.system, choices=("GEOG", "GEOC", "LOCL")),
        Field(
            "initial", "string", "where the first stations and attitudes come from", lambda o: o.initial,
            choices=("GIVEN", "COMPUTE", "CHECK"),
        ),
        Field(
            "refraction", "string", "treatment of submerged points", lambda o: o.refraction,
            choices=("NONE", "LEGACY", "WATPT", "RIGOROUS"),
        ),
        Field(
            "weights", "string", "weights of the conditions", lambda o: o.weights,
            choices=("FULL", "DIAGONAL", "EQUAL"),
        ),
        Field("max_iterations", "integer", "iterations of one triangulation, at most", lambda o: o.max_iterations),
        Field("max_passes", "integer", "passes of the water point correction, at most", lambda o: o.max_passes),
        Field(
            "rotation_limit", "number", "largest differential rotation of a converged run",
            lambda o: o.rotation_limit, "rad",
        ),
        Field(
            "translation_limit", "number", "largest differential translation of a converged run",
            lambda o: o.translation_limit, "m",
        ),
        Field(
            "water_limit", "number", "movement of submerged points that ends the passes", lambda o: o.water_limit,
            "m",
        ),
        Field(
            "plate_sigma", "number", "sigma of plate coordinates that have none of their own",
            lambda o: o.plate_sigma, "mm",
        ),
        Field(
            "submerged_factor", "number", "factor on the plate sigmas of submerged points",
            lambda o: o.submerged_factor,
        ),
        Field(
            "water_level", "string", "whose tides share an unknown correction", lambda o: o.water_level,
            choices=("KNOWN", "ONE", "PHOTO", "GROUP", "DAY"),
        ),
        Field(
            "water_tilt", "string", "tilt of the water surface", lambda o: o.water_tilt,
            choices=("KNOWN", "ADJUST"),
        ),
        Field("water_index", "string", "refractive index", lambda o: o.water_index, choices=("KNOWN", "ADJUST")),
        Field("datum", "string", "what holds the block as a whole", lambda o: o.datum, choices=("CONTROL", "FREE")),
        Field(
            "editing", "string", "what is done about blunders", lambda o: o.editing,
            choices=("NONE", "LIST", "EDIT"),
        ),
        Field(
            "order", "string", "order of the rows of stations, points, control and residuals", lambda o: o.order,
            choices=("CARDS", "IDS"),
        ),
        Field(
            "plate_sigma_is", "string", "whether sigma0 is tested against 1, or estimated",
            lambda o: o.plate_sigma_is, choices=("KNOWN", "GUESS"),
        ),
        Field("sigma0_limit", "number", "sigma0 from which a run is rejected", lambda o: o.sigma0_limit),
        Field(
            "station_limit", "number",
            "flying heights between adjusted and given stations, from which a run is doubtful",
            lambda o: o.station_limit,
        ),
    ),
)  # fmt: skip

ELLIPSOID = Group[Statistics, EllipsoidSpec](
    "ellipsoid",
    "null in local jobs",
    lambda s: s.block.ellipsoid,
    (
        Field("name", "string?", "PROJ name", lambda e: e.name or None),
        Field("semi_major_axis", "number?", "where there is no name", lambda e: e.semi_major_axis, "m"),
        Field("inverse_flattening", "number?", "where there is no name", lambda e: e.inverse_flattening),
    ),
    optional=True,
)

_PARTS = "parts per thousand"
_CONDITIONS = Group[Water, WaterConditions](
    "conditions",
    "what the index is computed from; null where the deck gives the index itself",
    lambda water: water.conditions,
    (
        Field("temperature", "number", "of the water", lambda c: c.temperature, "degC"),
        Field("wavelength", "number", "of the light, in vacuum", lambda c: c.wavelength, "nm"),
        Field(
            "salinity", "number?", "of the water; null where its chlorinity is given", lambda c: c.salinity, _PARTS
        ),
        Field(
            "chlorinity", "number?", "of the water; null where its salinity is given", lambda c: c.chlorinity,
            _PARTS,
        ),
        Field(
            "formula", "string", "of the index; empty is QUANFRY", lambda c: c.formula,
            choices=("", "QUANFRY", "IAPWS"),
        ),
        Field("air_temperature", "number?", "null is 15", lambda c: c.air_temperature, "degC"),
        Field("air_pressure", "number?", "null is 101325", lambda c: c.air_pressure, "Pa"),
    ),
    optional=True,
)  # fmt: skip
WATER = Group[Statistics, Water](
    "water",
    "null without a water card",
    lambda s: s.block.water,
    (
        Field("index", "number", "refractive index relative to air", lambda w: w.index),
        Field("sigma", "number?", "of the index", lambda w: w.sigma),
        Field(
            "tilt_east", "number?", "slope of the surface towards east; null is level", lambda w: w.tilt_east, "rad"
        ),
        Field("tilt_north", "number?", "slope towards north", lambda w: w.tilt_north, "rad"),
        Field("tilt_sigma", "number?", "of both slopes", lambda w: w.tilt_sigma, "rad"),
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
        Field("principal_point", "2 number", "xp, yp", lambda b: b.cameras.principal_point, "mm"),
        Field("format_size", "2 number?", "x, y", lambda b: b.cameras.format_size, "mm"),
    ),
)
DISTORTION = OfBlock(
    "distortion",
    "one row per distortion card",
    _block,
    (
        Field("camera", "string", "camera id", lambda b: b.cameras.ids[b.distortion.camera]),
        Field(
            "kind", "string", "radial, decentring or tabulated", lambda b: b.distortion.kind,
            choices=("RADL", "DCEN", "TABL"),
        ),
        Field(
            "values", "3 number?", "K1 K2 K3 (for r in mm), P1 P2 P3, or radius and distortion (mm)",
            lambda b: b.distortion.values,
        ),
    ),
)  # fmt: skip
FIDUCIALS = OfBlock(
    "fiducials",
    "one row per calibrated mark",
    _block,
    (
        Field("camera", "string", "camera id", lambda b: b.cameras.ids[b.fiducials.camera]),
        Field("mark", "string", "id of the mark", lambda b: b.fiducials.ids),
        Field("xy", "2 number", "calibrated", lambda b: b.fiducials.xy, "mm"),
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
        Field("xy", "2 number", "measured", lambda b: b.fiducial_measurements.xy, "mm"),
        Field("sigma", "2 number?", "of xy", lambda b: b.fiducial_measurements.sigma, "mm"),
    ),
)

COMPARATOR = Group[Statistics, ComparatorSpec](
    "comparator",
    "the comparator of raw plates, null without card; `unit` is that of its readings",
    lambda s: s.read.comparator,
    (
        Field("scale_u", "number", "of the first rail", lambda c: c.scale_u, "mm/unit"),
        Field("scale_v", "number", "of the second rail", lambda c: c.scale_v, "mm/unit"),
        Field(
            "non_orthogonality", "number", "by which the second rail leans towards the first",
            lambda c: c.non_orthogonality, "rad",
        ),
        Field("rotation", "number", "of the readings, counter-clockwise", lambda c: c.rotation, "rad"),
        Field("left_handed", "boolean", "the second rail is reversed", lambda c: c.left_handed),
        Field("reading_sigma", "number", "standard deviation of one reading", lambda c: c.reading_sigma, "unit"),
        Field(
            "repeat_limit", "number?", "of the deviation of repeated readings from their mean",
            lambda c: c.repeat_limit, "unit",
        ),
    ),
    optional=True,
)  # fmt: skip
LENSES = OfBlock(
    "lenses",
    "one row per lens card",
    _read,
    (
        Field("camera", "string", "camera id", lambda b: b.cameras.ids[b.lenses.camera]),
        Field("centre", "2 number?", "principal point of best symmetry", lambda b: b.lenses.centre, "mm"),
        Field(
            "k0", "number?", "linear coefficient of the radial distortion, as on the card", lambda b: b.lenses.k0
        ),
    ),
)
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
        Field("xy", "2 number", "calibrated", lambda b: b.reseau.xy, "mm"),
    ),
)
CROSS_MEASUREMENTS = OfBlock(
    "cross_measurements",
    "one row per reading of a reseau cross",
    _read,
    (
        Field("photo", "string", "photo id", lambda b: b.photos.ids[b.cross_measurements.photo]),
        Field("cross", "string", "cross id", lambda b: b.cross_measurements.ids),
        Field("xy", "2 number", "reading", lambda b: b.cross_measurements.xy, "unit"),
    ),
)
