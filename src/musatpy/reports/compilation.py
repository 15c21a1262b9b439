"""The listings and the records of a compilation and of models set up (`musat as11 compile`, `musat as11 setup`).

And of compiled points beside those of the run: AS-11 less MUSAT, as Table 6-7 has them (`as11 compare-points`).
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from musatpy.arrays import FloatArray, rms
from musatpy.model.tables import POSITION_UNIT
from musatpy.reports import analyses, compilation_bottom, compilation_points, headline, job_record
from musatpy.reports.answer import MARKS, verdict_section
from musatpy.reports.compilation_points import ENU_SIGMAS, CompilationReport
from musatpy.reports.editing import position
from musatpy.reports.fields import Document, Each, Field, FieldGroup, Rows, flag, identity, within
from musatpy.reports.pages import Section, labelled, print_titled, wrapped
from musatpy.reports.table import Report, Texts, sentences_at
from musatpy.statistics.analyses import DifferenceStatistics, analysis_of

if TYPE_CHECKING:  # a reader of listings knows the tables by their statements alone
    from musatpy.compilation.against_run import AgainstRun
    from musatpy.compilation.compiled import Compiled, CompiledModel
    from musatpy.model import Verdict
    from musatpy.model.compilation import ContourSpec

_ABOUT = (
    "Points compiled in stereomodels of a run, in metres and radians; positions are in the system of the job, "
    "sigmas along east, north, up (X, Y, Z in LOCL jobs). A number that does not exist is null"
)

JOB: FieldGroup[CompilationReport, Compiled] = FieldGroup(
    "job", "what was compiled", of=lambda c: c.compiled, fields=(
        Field("titles", "* string", "titles of the deck", "deck.titles"),
        Field("system", "string", "coordinate system of the run", "run.block.options.system"),
        job_record.part("ellipsoid", "ellipsoid", lambda c: c.run.block.ellipsoid),
        Field("caution", "string?", "to be known of the run, on every page", lambda c: c.run.caution or None),
        Field("index", "number?", "refractive index of the water",
              lambda c: getattr(c.run.block.water, "index", None)),
        Field("datum", "string?", "sounding datum", lambda c: getattr(c.deck.datum, "name", None)),
        Field("datum_height", "number", "of it, above its grid if it has one", "datum.height", unit="m"),
        Field("datum_grid", "string?", "grid file of its heights",
              lambda c: getattr(c.deck.datum, "geoid", None) or None),
        Field("datum_sigma", "number", "of that", "datum.sigma", unit="m"),
    ),
)  # fmt: skip
VERDICT: FieldGroup[CompilationReport, Verdict] = FieldGroup(
    "verdict", "what it is worth", headline.VERDICT.fields, lambda c: c.verdict
)
MODELS: Each[CompilationReport, CompiledModel] = Each(
    "models", "one row per stereomodel", of=lambda c: c.compiled.models, fields=(
        identity("model", "name"),
        Field("photos", "2 string", "left and right",
              lambda m: m.stereo.run.block.photos.ids[list(m.stereo.photos)], ("Left", "Right"), "A8"),
        Field("mode", "string", "IMAGE or PRINTED", heading="Mode", edit="A7"),
        Field("vertical", "string", "POINT or MODEL", lambda m: "MODEL" if m.printed.model_vertical else "POINT",
              "Vert.", "A5"),
        Field("tide", "string", "PHOTO or MEAN", lambda m: "MEAN" if m.printed.mean_tide else "PHOTO", "Tide",
              "A5"),
        Field("rays", "string", "OWN or SHARED", lambda m: "SHARED" if m.printed.shared_point else "OWN", "Rays",
              "A6"),
        Field("pointing", "number", "sigma of a pointing", heading="Pointing\num", edit="F8.2"),
        Field("limit", "number", "of differences of re-measured points", unit="mm"),
        Field("base", "number", "length of the base", "stereo.base", "Base\nm", "F9.2"),
        Field("height", "number", "of the stations over the origin", "stereo.height", "Height\nm", "F9.2"),
        Field("scale", "number", "scale number of the photographs at the origin", "stereo.scale", "Scale\n1 to",
              "F9.0"),
        Field("tides", "2 number?", "of the photos", "stereo.tides", ("Tide L\nm", "Tide R\nm"), "F7.3"),
        Field("origin", "3 number", "of the model axes, working", "stereo.origin",
              ("Origin X\nm", "Origin Y\nm", "Origin Z\nm"), "F11.3", exact=True),
        Field("axes", "3x3 number", "X, Y, Z of the model in working axes", "stereo.axes",
              [f"{axis}{of}" for axis in "XYZ" for of in "xyz"], "F7.4", exact=True),
        Field("origin_position", "3 number", "of the model axes, in the system of the job",
              lambda m: m.stereo.run.frame.system(m.stereo.origin[None])[0], position(4), unit=POSITION_UNIT,
              exact=True),
        Field("working_origin", "3 number", "of the working axes", "stereo.run.frame.origin", unit="m", exact=True),
        Field("points", "integer", "readings", lambda m: len(m.rows), "Points", "I6"),
        Field("compiled", "integer", "of these with a position", lambda m: len(m.rows) - len(m.points.reasons)),
        Field("y_parallax", "number?", "root mean square of all points", lambda m: rms(m.points.y_parallax),
              "RMS py\num", "F7.2"),
    ),
)  # fmt: skip
SHORELINES: Each[CompilationReport, tuple[str, FloatArray]] = Each(
    "shoreline", "one row per model with points of the shoreline: their heights over the mean tide",
    of=lambda c: _shorelines(c.compiled), fields=(
        identity("model", lambda s: s[0]),
        Field("points", "integer", "on the shoreline", lambda s: len(s[1]), "Points", "I6"),
        Field("mean", "number", "of the heights", lambda s: s[1].mean(), "Mean\nm", "F8.3"),
        Field("rms", "number", "root mean square", lambda s: rms(s[1]), "RMS\nm", "F8.3"),
        Field("largest", "number", "signed, of the largest magnitude", lambda s: s[1][np.abs(s[1]).argmax()],
              "Largest\nm", "F8.3"),
    ),
)  # fmt: skip
RECOVERED: Each[CompilationReport, AgainstRun] = Each(
    "recovered", "one row per model: readings of class R less what the points of the run predict",
    of=lambda c: c.against, fields=(
        identity("model", "model.name"),
        Field("points", "integer", "read again", lambda a: int(a.again.sum()), "Points", "I6"),
        Field("rms", "2x2 number?", "left and right, x and y",
              heading=[f"RMS {side} {axis}\num" for side in "LR" for axis in "xy"], edit="F9.2"),
        Field("largest", "number?", "of a coordinate", lambda a: a.largest[0], "Largest\num", "F9.2"),
        Field("point", "string?", "of the largest", lambda a: a.largest[1], "at Point", "A8"),
        Field("limit", "number", "of the root mean squares", "model.limit", "Limit\num", "F8.2"),
        Field("recovered", "boolean?", "none is over it; null without points", heading="Recovered", edit="A9",
              words={True: "yes", False: "NO", None: "NO"}),
    ),
)  # fmt: skip


def _all(path: str, of: str = "set_up") -> Callable[[CompilationReport], Any]:
    """Return what takes the values of all models, one after the other: as set up, or `against` the run."""
    return lambda done: np.concatenate([attrgetter(path)(part) for part in getattr(done, of)])


BESIDE_RUN: Rows[CompilationReport, CompilationReport] = Rows(
    "against_run", "one row per point that the run has too", (
        identity("model", lambda c: np.concatenate([[part.model.name] * len(part.rows) for part in c.against])),
        identity("point", lambda c: _points_of(c)),
        flag("shared", "its readings are those of the run", "Same", "S", _all("shared", "against")),
        Field("difference", "3 number", "compiled minus run, east, north, up", _all("difference", "against"),
              ("East\nm", "North\nm", "Up\nm"), "F7.4"),
        Field("length", "number", "of that", _all("length", "against"), "Length\nm", "F8.4"),
        Field("sigma", "3 number?", "of the difference; null where not known", _all("sigma", "against"), ENU_SIGMAS,
              "F7.4"),
        Field("test", "number?", "root of the mean square over its covariance", _all("test", "against"), "Test",
              "F6.2"),
        Field("stages", "2x2 number", "read minus predicted, left and right", _all("stages", "against"),
              [f"{side} {axis}\num" for side in ("Left", "Right") for axis in "xy"], "F7.2"),
    ),
)  # fmt: skip
ANALYSIS: Each[CompilationReport, tuple[str, DifferenceStatistics]] = Each(
    "analysis",
    "differences of compiled points from the run in numbers, east, north, up",
    of=lambda c: _statistics(c),
    fields=(
        Field("component", "string", "East, North, Up", lambda d: d[0]),
        *within(lambda d: d[1], analyses.differences("m", "point")),
    ),
)
CAUTION: Field[CompilationReport] = Field(
    "caution", "string?", "what is to be known of the run, on every page", lambda c: c.compiled.run.caution or None
)
RUN_TABLE = Report("Comparison With The Run", BESIDE_RUN, worst=lambda t: t["length"])
_ANALYSIS_TABLE = Report(
    "Ground Point Analysis",
    ANALYSIS,
    ("component size", ANALYSIS.column("maximum_id", "Point with Max. Difference", "A8")),
)
AGAINST_RUN: Document[CompilationReport] = Document(
    name="point_comparison_version",
    version="2.0",
    title="musatpy comparison of compiled points",
    about="Compiled points beside those of the run, in metres and millimetres of the stages.",
    nodes=(CAUTION, BESIDE_RUN, ANALYSIS),
)


WARNINGS_FIELD: Field[CompilationReport] = Field(
    "warnings", "* string", "what is odd about readings and models", lambda c: list(c.warnings)
)
DOCUMENT: Document[CompilationReport] = Document(
    name="compilation_version",
    version="2.0",
    title="musatpy compilation",
    about=_ABOUT,
    nodes=(
        *(VERDICT, JOB, MODELS, compilation_points.POINTS, compilation_points.ANSWER, SHORELINES, RECOVERED),
        *(BESIDE_RUN, ANALYSIS),
        *(compilation_points.PROFILES, compilation_points.SCANS),
        *compilation_bottom.RECORD,
        WARNINGS_FIELD,
    ),
)


def _models(path: str) -> Callable[[CompilationReport], Any]:
    """Return what takes the name of its model for each value."""
    return lambda setups: np.concatenate([[m.model.name] * len(attrgetter(path)(m)) for m in setups.set_up])


def _of_run(setups: CompilationReport, name: str) -> Any:
    """Return an attribute of the points of the run."""
    return getattr(setups.compiled.run.block.points, name)[_all("again.points")(setups)]


def _in_model(setups: CompilationReport) -> Any:
    run = setups.compiled.run
    places = (m.model.stereo.model(run.frame.working(run.position[m.again.points])) for m in setups.set_up)
    return np.concatenate(list(places))


RUN_POINTS: Rows[CompilationReport, CompilationReport] = Rows(
    "points", "one row per point of the run that both photos of a model show", (
        identity("model", _models("again.points")),
        identity("point", lambda s: _of_run(s, "ids")),
        flag("submerged", "flagged so", "Bath", "B", lambda s: _of_run(s, "bathymetric")),
        Field("position", "3 number", "in the model", _in_model, unit="m", exact=True),
        Field("predicted", "2x2 number", "stages, left and right, x and y", _all("again.predicted"),
              [f"{side} {axis}\nmm" for side in "LR" for axis in "xy"], "F10.4", exact=True),
        Field("difference", "2x2 number?", "read less predicted",
              lambda c: _all("again.read")(c) - _all("again.predicted")(c),
              [f"Read {side}{axis}\nless\num" for side in "LR" for axis in "xy"], "F8.2"),
        Field("y_parallax", "number?", "of refracted rays, by readings where there are any", _all("again.parallax"),
              "py\num", "F7.2"),
        Field("straight_y_parallax", "number?", "of straight rays", _all("again.straight"), "straight\num", "F8.2"),
    ),
)  # fmt: skip
EXPECTED: Rows[CompilationReport, CompilationReport] = Rows(
    "expected", "standard errors to expect of points at places of a model", (
        identity("model", _models("expected.depth")),
        Field("place", "3 number", "in the model", _all("expected.place"), ("X\nm", "Y\nm", "Z\nm"), "F10.2",
              exact=True),
        Field("depth", "number", "below the water; 0: dry, at its height", _all("expected.depth"), "Depth\nm",
              "F7.2"),
        Field("sigma", "3 number?", "east, north, up", _all("expected.sigma"), ENU_SIGMAS, "F8.3"),
        Field("depth_sigma", "number?", "of the depth", _all("expected.points.depth_sigma"), "Depth\nm", "F8.3"),
        Field("pointing_sigma", "number?", "of the height, by pointing", _all("expected.pointing"), "Pointing\nm",
              "F8.3"),
        Field("run_sigma", "number?", "of the height, by the run", _all("expected.of_run"), "Run\nm", "F8.3"),
    ),
)  # fmt: skip
SET_UP: Document[CompilationReport] = Document(
    name="setup_version",
    version="2.0",
    title="musatpy models set up",
    about=(
        "Stereomodels of a run, set up: metres, millimetres of the plate, radians. Model axes: X along the base, Z "
        "up at the origin. A number that does not exist is null"
    ),
    nodes=(JOB, MODELS, RECOVERED, RUN_POINTS, EXPECTED, WARNINGS_FIELD),
)


def _options(compiled: Compiled) -> dict[str, str]:
    """Return what run and deck ask for, label by label."""
    deck, datum, stated = compiled.deck, compiled.datum, compiled.run.stated
    options, water = compiled.run.block.options, compiled.run.block.water
    known = {"water_level": "level", "water_tilt": "tilt", "water_index": "index"}
    adjusted = [word for name, word in known.items() if getattr(options, name) != "KNOWN"]
    index = "none" if water is None else f"{water.index:.6f}"
    of_datum = f"{datum.title}, {datum.height:.4f} m, sigma {datum.sigma:.4f} m"
    words = {
        "Run": f"{options.program}, {options.system}, sigma0 {compiled.run.unit_sigma:.4f}",
        **({"Answer stated in": f"{stated.kind} {stated.definition}".strip()} if stated else {}),
        "Refractive index of the water": index,
        "Water adjusted by the run": ", ".join(adjusted) or "nothing",
        "Depths below": of_datum + (f" above {deck.datum.geoid}" if deck.datum and deck.datum.geoid else ""),
    }
    for label, spec in (("Contours of depth", deck.contours), ("Contours of height", deck.heights)):
        if spec is not None:
            words[label] = _contours(spec)
    return words


def _contours(spec: ContourSpec) -> str:
    """Return which contours are asked for."""
    texts = [f"every {spec.interval:g} m, one in {spec.index} thick"] if np.isfinite(spec.interval) else []
    listed = sorted({*spec.listed, *spec.listed_index})
    texts += [f"at {', '.join(f'{level:g}' for level in listed)} m"] if listed else []
    texts += [f"of grid {spec.grid}"] if spec.grid else []
    texts += [f"edges up to {spec.longest_edge:g} m"] if np.isfinite(spec.longest_edge) else []
    texts += [f"pieces from {spec.shortest:g} m"] if spec.shortest > 0.0 else []
    texts += [f"foreshore up to {spec.drying:g} m"] if np.isfinite(spec.drying) else []
    return ", ".join(texts)


def _shorelines(compiled: Compiled) -> list[tuple[str, FloatArray]]:
    of_models = (
        (model.name, compiled.over_water[(compiled.model_ids == model.name) & compiled.on_shore])
        for model in compiled.models
    )
    return [(name, heights) for name, heights in of_models if len(heights)]


# --- the listing ---

MODEL_TABLE = Report(
    "Model Set-Up", MODELS, "model photos mode vertical tide rays pointing base height tides points y_parallax"
)
RECOVERED_TABLE = Report("Recoverability: Points Read Again, Less What The Run Predicts", RECOVERED)
SHORE_TABLE = Report("Shoreline: Heights Over The Tide", SHORELINES)
GEOMETRY_TABLE = Report(
    "Scales, And Origins In The System Of The Job", MODELS, "model scale base height origin_position"
)
AXES_TABLE = Report("Model Axes In Working Axes", MODELS, "model origin axes")
RUN_POINT_TABLE = Report("Points Of The Run In The Model", RUN_POINTS)
EXPECTED_TABLE = Report("Standard Errors To Expect", EXPECTED)
WARNINGS = Texts("Warnings Of Run And Readings", lambda r: sentences_at(r, "warnings"), "warnings")
SET_UP_TABLES = (GEOMETRY_TABLE, AXES_TABLE, RUN_POINT_TABLE, EXPECTED_TABLE)
STATED = (*(WARNINGS, MODEL_TABLE, SHORE_TABLE, RECOVERED_TABLE, RUN_TABLE), *SET_UP_TABLES)


def sections_of(done: CompilationReport) -> list[Section]:
    """Return what the listing of a compilation says, section by section."""
    compiled, verdict = done.compiled, done.verdict
    assert verdict is not None
    names = zip(compiled.ids, compiled.model_ids, compiled.reasons, strict=True)
    reasons = [f"Point {point} of model {model}: {reason}." for point, model, reason in names if reason]
    return [
        verdict_section(verdict),
        *_model_sections(done),
        *([Section(title="Points Without Coordinates", lines=wrapped(reasons))] if reasons else []),
        *compilation_points.point_sections(done),
        *([SHORE_TABLE.section(done)] if _shorelines(compiled) else []),
        *compilation_points.profile_sections(done),
        *compilation_bottom.sections_of(done),
        *_comparison_sections(done),
    ]


def set_up_sections(done: CompilationReport) -> list[Section]:
    """Return what the listing of models set up says, section by section."""
    tables = [report.section(done, new_page=number > 1) for number, report in enumerate(SET_UP_TABLES)]
    return [*_model_sections(done), *tables]


def _model_sections(done: CompilationReport) -> list[Section]:
    """Return what a listing says of run, deck and models, warnings included."""
    read = any(part.again.any() for part in done.against)
    return [
        Section(title="Options", lines=labelled(_options(done.compiled))),
        MODEL_TABLE.section(done, _of_waves(done.compiled)),
        *([RECOVERED_TABLE.section(done)] if read else []),
        *([Section(title=WARNINGS.title, lines=wrapped(done.warnings, lead="- "))] if done.warnings else []),
    ]


def _of_waves(compiled: Compiled) -> str:
    """Return the note that rays go through the waves of the run, where it has some."""
    sea = compiled.run.sea
    if sea is None:
        return ""
    names = f" ({', '.join(sea.names)})" if sea.names else ""
    return f"Through the waves of the run{names}, as they stood at each exposure. Depths count from the tides."


def listing_of(
    done: CompilationReport,
    sections: list[Section],
    kind: str = "COMPILATION",
    *,
    carriage_control: bool = False,
    date: datetime.date | None = None,
) -> str:
    """Return the listing of a compilation, or of models set up, from its sections, on pages of 132 columns."""
    title, caution = "".join(done.compiled.deck.titles[:1]), done.compiled.run.caution
    mark = MARKS.get(done.verdict.grade, "") if done.verdict else ""
    return print_titled(kind, title, sections, caution, mark=mark, carriage_control=carriage_control, date=date)


def point_listing(done: CompilationReport) -> str:
    """Return the listing of a comparison, on pages of 60 lines of 132 columns."""
    return listing_of(done, _comparison_sections(done), "COMPARISON OF POINTS")


def _comparison_sections(done: CompilationReport) -> list[Section]:
    """Return the differences, in the layout of Table 6-7 too; nothing where no point is one of the run."""
    if not any(len(part.rows) for part in done.against):
        return []
    lengths = ", ".join(f"{length:.4f}" for length in vectors(done))
    lines = {"Least, mean and largest vector, m": lengths}
    tests = _all("test", "against")(done)
    if np.isfinite(tests).any():
        lines["Tests, root of the mean square"] = f"{np.sqrt(np.nanmean(np.square(tests))):.2f}"
    block = done.compiled.run.block
    water = "No Refraction Correction" if block.water is None else "Refraction Correction Applied"
    runs = f"Compiled Less MUSAT-{block.options.program}", water
    return [
        RUN_TABLE.section(done, new_page=True),
        analyses.laid_out(_ANALYSIS_TABLE, _ANALYSIS_TABLE.values(done), runs, {"m": "F16.4"}),
        Section(title="Comparison With The Run: Vectors And Tests", lines=labelled(lines)),
    ]


def vectors(done: CompilationReport) -> tuple[float, float, float]:
    """Return the least, the mean and the largest length of the differences, m."""
    length = _all("length", "against")(done)
    return float(length.min()), float(length.mean()), float(length.max())


def _statistics(done: CompilationReport) -> list[tuple[str, DifferenceStatistics]]:
    """Return the components of the differences with their statistics, none where there are no differences."""
    if not any(len(part.rows) for part in done.against):
        return []
    units = dict.fromkeys(("East", "North", "Up"), "m")
    analysis = analysis_of(units, _points_of(done), _all("difference", "against")(done))
    return list(zip(analysis.components, analysis.statistics, strict=True))


def _points_of(done: CompilationReport) -> Any:
    return np.concatenate([part.model.readings.ids[part.rows] for part in done.against])
