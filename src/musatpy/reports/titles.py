"""First page: program, titles, options and the size of the job."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import musatpy
from musatpy.model import Block, CoordinateSystem, Editing, Initial, Options, Refraction, WaterLevel, Weights
from musatpy.reports import stated
from musatpy.reports.editing import number_text
from musatpy.reports.job_record import HOMES
from musatpy.reports.pages import PAGE_WIDTH, Section, labelled, wrapped
from musatpy.reports.table import Content, Labels, count_at, numbers_at
from musatpy.statistics import Statistics
from musatpy.units import ARC_SECOND, MICROMETRE

SYSTEMS = {
    CoordinateSystem.GEOGRAPHIC: "geographic: latitude, longitude, elevation",
    CoordinateSystem.GEOCENTRIC: "geocentric X, Y, Z",
    CoordinateSystem.LOCAL: "local rectangular X, Y, Z",
}
REFRACTION = {
    Refraction.NONE: "none",
    Refraction.LEGACY: "water point correction as printed in 1983",
    Refraction.WATPT: "water point correction, differential form",
    Refraction.RIGOROUS: "refracted rays in the conditions",
}
INITIAL = {
    Initial.GIVEN: "station and attitude cards",
    Initial.COMPUTE: "found from plate coordinates and control",
    Initial.CHECK: "station and attitude cards, compared with computed values",
}
WATER_LEVEL = {
    WaterLevel.KNOWN: "none",
    WaterLevel.ONE: "one, of all photos",
    WaterLevel.PHOTO: "one of each photo",
    WaterLevel.GROUP: "one of each group of photos",
    WaterLevel.DAY: "one of each day",
}
EDITING = {
    Editing.NONE: "not looked for",
    Editing.LIST: "looked for and listed",
    Editing.EDIT: "looked for, listed and taken out",
}
WEIGHTS = {
    Weights.FULL: "as in a simultaneous bundle",
    Weights.DIAGONAL: "variances of the conditions only",
    Weights.EQUAL: "one weight for each kind of condition",
}


@dataclass(frozen=True)
class _Number:
    """How an option is printed that is a number."""

    edit: str
    unit: float = 1.0  # of print, in units of the record
    name: str = ""  # of that unit


# Options by their names in the block and the record, with their labels, and what is said of them.
_OPTIONS: dict[str, tuple[str, Mapping[Any, str] | _Number | str]] = {
    "initial": ("Initial values", INITIAL),
    "refraction": ("Refraction", REFRACTION),
    "weights": ("Weights of conditions", WEIGHTS),
    "max_iterations": ("Iterations, at most", _Number("I9")),
    "max_passes": ("Passes of the water point correction, at most", _Number("I9")),
    "rotation_limit": ("Rotation limit", _Number("F12.4", ARC_SECOND, "arc seconds")),
    "translation_limit": ("Translation limit", _Number("F12.5", name="m")),
    "water_limit": ("Limit of movement of submerged points", _Number("F12.5", name="m")),
    "plate_sigma": ("Sigma of plate coordinates", _Number("F12.2", MICROMETRE, "um")),
}
_OFF_DEFAULT: dict[str, tuple[str, Mapping[Any, str] | _Number | str]] = {  # most jobs leave these as they are
    "submerged_factor": ("Factor on it for submerged points", _Number("F8.2")),
    "water_level": ("Unknown corrections of the tides", WATER_LEVEL),
    "water_tilt": ("Tilt of the water surface", "an unknown of the adjustment"),
    "water_index": ("Refractive index", "an unknown of the adjustment"),
    "datum": ("Datum", "inner constraints over the points where nothing holds the block"),
    "editing": ("Blunders", EDITING),
    "order": ("Order of rows", "by the identifiers of photos and points"),
    "plate_sigma_is": ("Plate sigmas", "estimated by their variance component"),
    "sigma0_limit": ("Sigma0 from which a run is rejected", _Number("F8.2")),
    "station_limit": ("Flying heights from given stations, doubtful from", _Number("F8.2")),
}


def _limits(content: Content) -> dict[str, Sequence[float | None]]:
    """Return the numbers of the options by their labels, as a record has them."""
    labels: dict[str, Sequence[float | None]] = {
        label: numbers_at(content, f"options.{name}", unit=said.unit)
        for name, (label, said) in (_OPTIONS | _OFF_DEFAULT).items()
        if isinstance(said, _Number)
    }
    return labels | {"Refractive index of water": numbers_at(content, "water.index", "water.sigma")}


_COUNTS = {  # tables of the block, of which rows are counted, or those that a flag is true of
    "Cameras": "cameras",
    "Photos": "photos",
    "Ground points": "points",
    "Submerged points": "points.bathymetric",
    "Plate measurements": "plates",
    "Control points, check points included": "control",
    "Equal elevation groups": "equal_elevations",
    "Air bases": "air_bases",
    "Distances": "distances",
    "Height differences": "height_differences",
}
_LEFT_OUT = ("Distances", "Height differences")  # where there are none


def _counts(content: Content) -> dict[str, Sequence[float | None]]:
    """Return the sizes of the tables by their labels, as a record has them."""
    left_out = "plates" if content.get("content") == "tables" else ""
    places = {label: name.partition(".") for label, name in _COUNTS.items() if name != left_out}
    return {label: [count_at(content, HOMES.get(table, table), of)] for label, (table, _, of) in places.items()}


SIZE = Labels("Size Of The Job", _counts)
STATED = (Labels("Options", _limits), SIZE)


def sections(statistics: Statistics) -> list[Section]:
    """Return titles, options and counts."""
    block = statistics.block
    (lead,) = labelled({"Set for this run": ""})
    settings = wrapped([", ".join(block.settings)], lead=lead) if block.settings else []
    options: list[str] = []
    for line in labelled(_options(block)):
        options += [line] if len(line) <= PAGE_WIDTH else wrapped([line[len(lead) :]], lead=line[: len(lead)])
    program = [f"musatpy version {musatpy.__version__}: MUSAT-{block.options.program} aerotriangulation", ""]
    return [
        Section(title="AEROTRIANGULATION", lines=[*program, *block.titles]),
        Section(title="Options", lines=[*options, *settings]),
        *stated.systems(statistics),
        Section(title="Size Of The Job", lines=labelled(_sizes(block))),
    ]


def _options(block: Block) -> dict[str, str]:
    options, default, water = block.options, Options(), block.water
    computed = water.conditions if water else None
    words = {
        "Program": f"MUSAT-{options.program}",
        f"Coordinate system{' of the adjustment' if block.answer_in else ''}": f"{options.system}  "
        f"{SYSTEMS[options.system]}",
        **dict(_line(options, name) for name in _OPTIONS),
        **dict(_line(options, name) for name in _OFF_DEFAULT if getattr(options, name) != getattr(default, name)),
        "Ellipsoid": _ellipsoid(block),
        "Refractive index of water": number_text("F9.6", water.index) + _sigma("F9.6", water.sigma)
        if water
        else "not given",
    }
    if computed:
        words |= {"Refractive index computed for water of": computed.of_water, "relative to": computed.of_air}
    if water and water.liquid:
        words["Liquid, which is not water"] = water.liquid
    tilts = (water.tilt_east, water.tilt_north, water.tilt_sigma) if water else (None,)
    if any(value is not None for value in tilts):
        east, north, sigma = (None if value is None else value / ARC_SECOND for value in tilts)
        text = f"{number_text('F10.3', east or 0.0)} arc seconds towards east, "
        text += f"{number_text('F10.3', north or 0.0)} towards north"
        words["Tilt of the water on its card"] = text + _sigma("F10.3", sigma)
    return words


def _sigma(edit: str, sigma: float | None) -> str:
    return "" if sigma is None else f", sigma {number_text(edit, sigma)}"


def _line(options: Options, name: str) -> tuple[str, str]:
    """Return the label of an option, and what it is."""
    (label, said), value = (_OPTIONS | _OFF_DEFAULT)[name], getattr(options, name)
    if isinstance(said, _Number):
        return label, f"{number_text(said.edit, value / said.unit)} {said.name}".rstrip()
    return label, f"{value}  {said if isinstance(said, str) else said[value]}"


def _ellipsoid(block: Block) -> str:
    spec = block.ellipsoid
    if spec is None:
        return "none"
    if spec.name:
        return spec.name
    axis = number_text("F14.4", spec.semi_major_axis or 0.0)
    return f"a = {axis} m, 1/f = {number_text('F16.9', spec.inverse_flattening or 0.0)}"


def _sizes(block: Block) -> dict[str, str]:
    counts = {}
    for label, name in _COUNTS.items():
        table, _, of = name.partition(".")
        rows = getattr(block, table)
        counts[label] = int(getattr(rows, of).sum()) if of else rows.count
    return {label: str(count) for label, count in counts.items() if count or label not in _LEFT_OUT}
