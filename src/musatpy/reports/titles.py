"""First page: program, titles, options and the size of the job."""

from __future__ import annotations

from collections.abc import Callable

import musatpy
from musatpy.model import (
    Block,
    CoordinateSystem,
    Editing,
    Initial,
    Options,
    Refraction,
    WaterLevel,
    Weights,
)
from musatpy.reports import stated
from musatpy.reports.editing import number_text
from musatpy.reports.origin import Mapped, Origin
from musatpy.reports.pages import Section
from musatpy.reports.text import labelled, wrapped
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

_LIMITS = {
    "Iterations, at most": Origin(field="options.max_iterations"),
    "Passes of the water point correction, at most": Origin(field="options.max_passes"),
    "Rotation limit": Origin(field="options.rotation_limit", unit="arc sec"),
    "Translation limit": Origin(field="options.translation_limit"),
    "Limit of movement of submerged points": Origin(field="options.water_limit"),
    "Sigma of plate coordinates": Origin(field="options.plate_sigma", unit="um"),
    "Factor on it for submerged points": Origin(field="options.submerged_factor"),
    "Sigma0 from which a run is rejected": Origin(field="options.sigma0_limit"),
    "Flying heights from given stations, doubtful from": Origin(field="options.station_limit"),
    "Refractive index of water": Origin(field="water.index", then=("water.sigma",)),
}
_COUNTS: dict[str, tuple[Origin, Callable[[Block], int]]] = {  # in the record, and in a block
    "Cameras": (Origin(count=True, field="cameras"), lambda b: b.cameras.count),
    "Photos": (Origin(count=True, field="stations"), lambda b: b.photos.count),
    "Ground points": (Origin(count=True, field="points"), lambda b: b.points.count),
    "Submerged points": (
        Origin(count=True, field="points", where="bathymetric"),
        lambda b: int(b.points.bathymetric.sum()),
    ),
    "Plate measurements": (Origin(count=True, field="plates"), lambda b: b.plates.count),
    "Control points, check points included": (Origin(count=True, field="control"), lambda b: b.control.count),
    "Equal elevation groups": (Origin(count=True, field="equal_elevations"), lambda b: b.equal_elevations.count),
    "Air bases": (Origin(count=True, field="air_bases"), lambda b: b.air_bases.count),
    "Distances": (Origin(count=True, field="distances"), lambda b: b.distances.count),
    "Height differences": (Origin(count=True, field="height_differences"), lambda b: b.height_differences.count),
}
_LEFT_OUT = ("Distances", "Height differences")  # where there are none
SIZE = Mapped(
    title="Size Of The Job", layout="labels", columns={label: origin for label, (origin, _) in _COUNTS.items()}
)
STATED = (Mapped(title="Options", layout="labels", columns=_LIMITS), SIZE)


def sections(statistics: Statistics) -> list[Section]:
    """Return titles, options and counts."""
    block = statistics.block
    program = [f"musatpy version {musatpy.__version__}: MUSAT-{block.options.program} aerotriangulation", ""]
    return [
        Section(title="AEROTRIANGULATION", lines=[*program, *block.titles]),
        Section(title="Options", lines=[*labelled(_options(block)), *_settings(block)]),
        *stated.systems(statistics),
        Section(title="Size Of The Job", lines=labelled(_sizes(block))),
    ]


def _options(block: Block) -> dict[str, str]:
    options = block.options
    system = "Coordinate system" if block.answer_in is None else "Coordinate system of the adjustment"
    return {
        "Program": f"MUSAT-{options.program}",
        system: f"{options.system}  {SYSTEMS[options.system]}",
        "Initial values": f"{options.initial}  {INITIAL[options.initial]}",
        "Refraction": f"{options.refraction}  {REFRACTION[options.refraction]}",
        "Weights of conditions": f"{options.weights}  {WEIGHTS[options.weights]}",
        "Iterations, at most": str(options.max_iterations),
        "Passes of the water point correction, at most": str(options.max_passes),
        "Rotation limit": f"{number_text('F12.4', options.rotation_limit / ARC_SECOND)} arc seconds",
        "Translation limit": f"{number_text('F12.5', options.translation_limit)} m",
        "Limit of movement of submerged points": f"{number_text('F12.5', options.water_limit)} m",
        "Sigma of plate coordinates": f"{number_text('F12.2', options.plate_sigma / MICROMETRE)} um",
        **_off_default(options),
        "Ellipsoid": _ellipsoid(block),
        "Refractive index of water": _index(block),
        **_conditions(block),
        **({"Liquid, which is not water": block.water.liquid} if block.water and block.water.liquid else {}),
        **_tilt(block),
    }


def _settings(block: Block) -> list[str]:
    """Return what was set for the run: of its cards, which the lines above have already, and its options."""
    (lead,) = labelled({"Set for this run": ""})
    return wrapped([", ".join(block.settings)], lead=lead) if block.settings else []


def _off_default(options: Options) -> dict[str, str]:
    """Return the lines of options that most jobs leave as they are."""
    default = Options()
    lines = {
        "submerged_factor": ("Factor on it for submerged points", number_text("F8.2", options.submerged_factor)),
        "water_level": (
            "Unknown corrections of the tides",
            f"{options.water_level}  {WATER_LEVEL[options.water_level]}",
        ),
        "water_tilt": ("Tilt of the water surface", f"{options.water_tilt}  an unknown of the adjustment"),
        "water_index": ("Refractive index", f"{options.water_index}  an unknown of the adjustment"),
        "datum": ("Datum", f"{options.datum}  inner constraints over the points where nothing holds the block"),
        "editing": ("Blunders", f"{options.editing}  {EDITING[options.editing]}"),
        "order": ("Order of rows", f"{options.order}  by the identifiers of photos and points"),
        "plate_sigma_is": (
            "Plate sigmas",
            f"{options.plate_sigma_is}  estimated by their variance component",
        ),
        "sigma0_limit": ("Sigma0 from which a run is rejected", number_text("F8.2", options.sigma0_limit)),
        "station_limit": (
            "Flying heights from given stations, doubtful from",
            number_text("F8.2", options.station_limit),
        ),
    }
    return dict(line for name, line in lines.items() if getattr(options, name) != getattr(default, name))


def _ellipsoid(block: Block) -> str:
    spec = block.ellipsoid
    if spec is None:
        return "none"
    if spec.name:
        return spec.name
    axis = number_text("F14.4", spec.semi_major_axis or 0.0)
    return f"a = {axis} m, 1/f = {number_text('F16.9', spec.inverse_flattening or 0.0)}"


def _index(block: Block) -> str:
    if block.water is None:
        return "not given"
    text = number_text("F9.6", block.water.index)
    if block.water.sigma is not None:
        text += f", sigma {number_text('F9.6', block.water.sigma)}"
    return text


def _tilt(block: Block) -> dict[str, str]:
    """Return the line of the tilt of the water, nothing where the card says nothing of it."""
    water = block.water
    if water is None or all(value is None for value in (water.tilt_east, water.tilt_north, water.tilt_sigma)):
        return {}
    east, north = (
        number_text("F10.3", (slope or 0.0) / ARC_SECOND) for slope in (water.tilt_east, water.tilt_north)
    )
    text = f"{east} arc seconds towards east, {north} towards north"
    if water.tilt_sigma is not None:
        text += f", sigma {number_text('F10.3', water.tilt_sigma / ARC_SECOND)}"
    return {"Tilt of the water on its card": text}


def _conditions(block: Block) -> dict[str, str]:
    """Return the lines that say what the index comes from, where it does not stand in the deck itself."""
    if block.water is None or block.water.conditions is None:
        return {}
    conditions = block.water.conditions
    return {"Refractive index computed for water of": conditions.of_water, "relative to": conditions.of_air}


def _sizes(block: Block) -> dict[str, str]:
    counts = {label: count(block) for label, (_, count) in _COUNTS.items()}
    return {label: str(count) for label, count in counts.items() if count or label not in _LEFT_OUT}
