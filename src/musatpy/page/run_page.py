"""The page of a run: its chapters, each with tables of the listing, and which of their rows stand there."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from musatpy.arrays import FloatArray, rows_of
from musatpy.model import Cause, ObservationKind, Refraction
from musatpy.page import accuracy, page_tables
from musatpy.page.page_tables import cell_text, number_text, significant, size_text
from musatpy.page.rendering import Fact, Facts, Page, PageTable, Part, Sentences
from musatpy.plots.picture import NothingToShowError, counted
from musatpy.plots.plane import plane_of
from musatpy.records.tables import Tables, numbers, part, texts
from musatpy.reports import (
    adjusted_water,
    analyses,
    answer,
    bathymetric,
    blunders,
    common_errors,
    control,
    echo,
    iterations,
    job_record,
    kinds,
    parameters,
    positions,
    reduction,
    statistical_tests,
    titles,
)
from musatpy.reports.fields import Field, same
from musatpy.reports.headline import headline
from musatpy.reports.stated import answered
from musatpy.reports.table import Report
from musatpy.reports.values import at
from musatpy.statistics.quality import TEST_LIMIT
from musatpy.units import ARC_SECOND, MICROMETRE

_PHOTOS = 250  # rows of tables of photos
_CONTROL = 500
_POINTS = 100
_FEW = 20
_WARNINGS = 50
_CAUSES = 5
_KILOMETRE2 = 1e6  # m2
_BY_KIND = ("Observations, ", "Unknowns, ", "Sigma0, ")  # labels of numbers that are told beside others
_HELD = (
    "Cameras are taken as calibrated: focal length, principal point and distortion are no unknowns of the "
    "adjustment, and without error; what is wrong in them is in the residuals."
)
_NO_TESTS = "The solution carries no statistics of its observations."
_OPTION_WORDS: Mapping[str, Mapping[Any, str]] = {
    "system": titles.SYSTEMS,
    "initial": titles.INITIAL,
    "refraction": titles.REFRACTION,
    "weights": titles.WEIGHTS,
    "water_level": titles.WATER_LEVEL,
    "editing": titles.EDITING,
}
_FINDINGS = Report(
    answer.BLUNDERS.title, blunders.FINDINGS, (answer.BLUNDERS.columns, "note"), worst=lambda t: np.abs(t["test"])
)
_open = partial(page_tables.PageReport, folded=False)
_of_photos = partial(page_tables.PageReport, listed=_PHOTOS)

_LEFT_OUT = (_open(positions.NO_PART), _open(_FINDINGS))
_DIFFERENCES = (
    _open(control.RESIDUALS, _CONTROL, note=control.NOTE),
    _open(control.DIFFERENCES, _CONTROL),
    page_tables.PageReport(statistical_tests.CHECKS, _CONTROL),
)
_ACCURACY = (
    page_tables.PageReport(
        bathymetric.DEPTHS,
        note="No refr.: where straight rays of the adjusted stations meet; predicted: that times the index.",
    ),
    _open(iterations.PLATE_RESIDUALS),
    _open(
        statistical_tests.COMPONENTS,
        note="The factor of a group is v'Pv over its redundancy, 1 where its sigmas are right; limits of 95 %.",
    ),
)
_CAMERA = (
    _open(echo.card("CAM")),
    _open(parameters.REPORT),
    page_tables.PageReport(parameters.TIED),
    page_tables.PageReport(parameters.DISTORTION),
    *(page_tables.PageReport(echo.card(card)) for card in ("DST", "LNS", "FID", "FDS")),
)
_WATER = (
    _open(bathymetric.FLAG_TABLE),
    _of_photos(adjusted_water.CORRECTIONS),
    _open(adjusted_water.CONSIDERED),
    page_tables.PageReport(echo.SEA),
    _open(adjusted_water.WAVES),
    page_tables.PageReport(adjusted_water.PARAMETERS_OF_WAVES),
    page_tables.PageReport(adjusted_water.CORRELATIONS, _FEW),
    _open(statistical_tests.WATER),
    page_tables.PageReport(statistical_tests.CORRELATIONS, 2 * _FEW),
)
_OBSERVATIONS = (
    _open(
        statistical_tests.OBSERVATIONS,
        _FEW,
        note=f"* beyond {TEST_LIMIT:.2f}. The smallest detectable error is found with a probability of 0.80; its "
        "effect is on the own position.",
    ),
    page_tables.PageReport(
        statistical_tests.HIDDEN_ERRORS,
        _FEW,
        note="By an error of one image or control component which its own test does not find.",
    ),
    _open(
        common_errors.TESTS,
        note="Movements are those by the reference error; no test: residuals show no error that may be.",
    ),
    page_tables.PageReport(common_errors.HIDDEN),
)
_RESULTS = (
    _of_photos(positions.POSITIONS),
    _of_photos(positions.ATTITUDES),
    page_tables.PageReport(positions.GROUND_POINTS),
    _of_photos(analyses.BY_PHOTO),
    _of_photos(statistical_tests.STATION_ELLIPSES),
    page_tables.PageReport(statistical_tests.POINT_ELLIPSES, _FEW),
    _of_photos(statistical_tests.STATION_INFLATION),
    *map(_of_photos, control.CONSTRAINTS),
    *map(_of_photos, kinds.STATED),
)
_COMPUTED = (
    page_tables.PageReport(iterations.ITERATION_TABLE),
    page_tables.PageReport(iterations.PASS_TABLE),
    _of_photos(reduction.PLATES),
    *(page_tables.PageReport(report) for report in (reduction.MARKS, reduction.DISTANCES, reduction.SPREADS)),
)


def run_page(tables: Tables) -> Page:
    """Return the page of the record of a run."""
    contents = {
        "Data": _data(tables),
        "What Was Left Out": _left_out(tables),
        "Accuracy": _accuracy(tables),
        "Camera And Water": _camera(tables),
        "Worst Observations And Blunders": [*page_tables.tables_of(_OBSERVATIONS, tables)]
        or [Sentences(texts=[_NO_TESTS])],
        "Stations And Points": [*_stated(tables), *page_tables.tables_of(_RESULTS, tables)],
        "How It Was Computed": _computed(tables),
    }
    chapters = page_tables.chapters_of(contents)
    what = f"MUSAT-{tables['options']['program']} aerotriangulation. {_what(tables)}"
    figures = _figures(tables, page_tables.places_of(chapters))
    page = page_tables.page_of(tables, tables["titles"] or ["Aerotriangulation"], what, figures, chapters)
    return replace(page, causes=_causes(tables["causes"][:_CAUSES]) if page.reasons else ())


def _what(tables: Tables) -> str:
    points, wet = tables["points"]["point"], sum(tables["points"]["bathymetric"])
    images = part(tables, "plates").get("photo")  # a record may be without them
    count = tables["plate_statistics"]["total_count"][-1] if images is None else len(images)
    refraction = titles.REFRACTION[Refraction(tables["options"]["refraction"])]
    return (
        f"{counted(len(tables['stations']['photo']), 'photo')}, {counted(len(points), 'ground point')} "
        f"({wet:,} submerged), {counted(count, 'image')}. Refraction: {refraction}."
    )


def _causes(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return likely causes in words; of one group those after the first begin with `or`."""
    sentences, groups = [], set()
    for row in rows:
        lead = "or: " if row["group"] in groups else ""
        groups.add(row["group"])
        sentences.append(f"{lead}{Cause.of_row(row)}")
    return sentences


def _figures(tables: Tables, places: Mapping[str, str]) -> Iterator[Fact]:
    """Yield the figures of page 1 of the listing, and the order of the depths."""
    for figure in headline(tables, cell_text):
        value, detail = figure.value.replace(" um", " µm"), figure.detail.lstrip(",: ")
        yield Fact(figure.label, value, detail=detail, link=page_tables.place_of(places, figure.section))
    yield from accuracy.order_facts(accuracy.depths_of(tables), places)


def _data(tables: Tables) -> Iterator[Part]:
    sizes = _known(titles.SIZE.numbers(tables))
    counts = [Fact(label, f"{values[0]:,}") for label, values in sizes.items() if values[0]]
    yield Facts([*counts, *_flight_facts(tables), *_times_fact(tables)])
    details = {
        f"{noun}, all": ", ".join(f"{kind} {count:,}" for kind, count in counts.items() if count)
        for noun in ("Observations", "Unknowns")
        for counts in [tables["solution"][noun.lower()]]
    }
    yield Facts(
        [
            Fact(label, f"{value:,}" if isinstance(value, int) else significant(value), details.get(label, ""))
            for label, (value, *_) in _known(iterations.SUMMARY.numbers(tables)).items()
            if not label.startswith(_BY_KIND) or label in details
        ]
    )
    yield from _rays_table(tables)
    yield from page_tables.tables_of([_of_photos(echo.card("TID"))], tables)


def _known(labels: Mapping[str, Sequence[float | None]]) -> dict[str, list[float]]:
    """Return labels with the numbers that a record has of them."""
    known = {label: [value for value in values if value is not None] for label, values in labels.items()}
    return {label: values for label, values in known.items() if values}


def _left_out(tables: Tables) -> Iterator[Part]:
    status, triangulated = texts(tables["points"], "status"), part(tables, "plates").get("triangulated", ())
    counts = (
        ("Points intersected, not triangulated", int((status == "intersected").sum()), len(status)),
        ("Points without a position", int((status == "not_determined").sum()), len(status)),
        ("Images kept out of the solution", len(triangulated) - sum(triangulated), len(triangulated)),
    )
    facts = [Fact(label, f"{n:,}", detail=f"of {total:,}") for label, n, total in counts if n]
    shown: list[Part] = [Facts(facts)] if facts else []
    shown += page_tables.tables_of(_LEFT_OUT, tables)
    if unedited := tables["unedited"]:
        shown.append(Sentences(texts=[f"EDIT has edited nothing: {unedited}."]))
    if warnings := tables["solution"]["warnings"]:
        more = [f"And {len(warnings) - _WARNINGS:,} more: the record has all."] * (len(warnings) > _WARNINGS)
        shown.append(Sentences(texts=[*warnings[:_WARNINGS], *more], title="Warnings", listed=True))
    yield from shown or [Sentences(texts=["Nothing: every image took part, and every point has a position."])]


def _accuracy(tables: Tables) -> Iterator[Part]:
    every, depths = accuracy.samples(tables), accuracy.depths_of(tables)
    if every:
        yield accuracy.sample_table(every)
    else:
        yield Sentences(texts=["No control point or check point says how far positions are from given ones."])
    yield from page_tables.tables_of(_DIFFERENCES, tables)
    sentences = list(accuracy.refraction_sentences(tables, depths))
    if sentences:
        yield Sentences(texts=sentences, title="What Refraction Changed")
    yield from accuracy.orders_table(depths)
    yield from page_tables.tables_of(_ACCURACY, tables)


def _camera(tables: Tables) -> Iterator[Part]:
    yield from page_tables.tables_of(_CAMERA, tables)
    if ObservationKind.LENS.label not in part(tables, "adjusted_parameters").get("kind", ()):
        yield Sentences(texts=[_HELD])
    water = part(tables, "adjusted_water")
    if water:
        yield Facts(list(_water(tables)))
        if exact := water["without_error"]:
            yield Sentences(texts=[f"Taken to be without error, as the cards give no sigma: {'; '.join(exact)}."])
    yield from page_tables.tables_of(_WATER, tables)


def _water(tables: Tables) -> Iterator[Fact]:
    """Yield tilt and index of the water, as the listing calls them."""
    undetermined = " ".join(tables["adjusted_water"]["undetermined"])
    for label, values in _known(adjusted_water.SURFACE.numbers(tables)).items():
        unit = "" if label == "Refractive index" else " ″"
        if label.split()[0].lower() in undetermined:  # tilt, refractive
            yield Fact(label, "not determined")
        else:
            sigma = f"sigma {significant(values[1])}{unit}" if len(values) > 1 else "known"
            yield Fact(label, f"{significant(values[0])}{unit}", detail=sigma)


def _stated(tables: Tables) -> Iterator[Part]:
    """Yield stations and points in the output coordinate system, where the deck asks for one."""
    if stated := tables["stated"]:
        stations, points = positions.in_words(stated["answer"])
        for report, listed in (*((station, _PHOTOS) for station in stations), (points, _POINTS)):
            other = replace(report, title=f"{report.title}: In The Output System")
            shown = page_tables.PageReport(other, listed, note=f"{stated['answer']['text']}.")
            yield from page_tables.tables_of([shown], answered(tables, "stations", "points"))


def _computed(tables: Tables) -> Iterator[Part]:
    if settings := tables.get("settings"):
        yield Sentences(texts=[f"Set for this run: {', '.join(settings)}."])
    yield _options(tables["options"])
    for report in analyses.REPORTS:
        yield accuracy.analysis_table(at(tables, report.place), report.title, str(report.stated()[-1].heading))
    yield from page_tables.tables_of(_COMPUTED, tables)


def _options(values: Mapping[str, Any]) -> PageTable:
    """Return the options of the run, as the record describes them."""
    stated = job_record.part("options", "options", same).fields
    fields = [field for field in stated if isinstance(field, Field) and field.name in values]
    return page_tables.page_table(
        "Options",
        [
            ("Option", "A20", [field.name.replace("_", " ") for field in fields]),
            ("Value", "A20", [_option(values[field.name], field.unit) for field in fields]),
            (
                "Meaning",
                "A80",
                [_OPTION_WORDS.get(field.name, {}).get(values[field.name]) or field.text for field in fields],
            ),
        ],
        folded=True,
    )


def _option(value: Any, unit: str) -> str:
    if unit == "rad":
        value, unit = value / ARC_SECOND, "arc seconds"
    text = significant(value) if isinstance(value, float) else str(value)
    return f"{text} {unit}".rstrip()


# --- what stations and points say of the flight: height, scale, area, overlap, times ---


def _flight_facts(tables: Tables) -> Iterator[Fact]:
    """Yield height, scale and area of a block, as far as its stations and points have places."""
    try:
        plane = plane_of(tables)
    except NothingToShowError:
        return
    stations = part(tables, "stations")
    flown = plane.places(numbers(stations, "position", 3))
    ground = plane.places(numbers(part(tables, "points"), "position", 3))
    ground, flown = (places[np.isfinite(places).all(axis=1)] for places in (ground, flown))
    if not len(ground) or not len(flown):
        return
    level, height = float(np.median(ground[:, 2])), float(np.median(flown[:, 2]))
    yield Fact(
        "Flying height over the ground",
        f"{number_text(height - level, 0)} m",
        detail=f"stations {flown[:, 2].min():.0f} to {flown[:, 2].max():.0f} m, points typically at {level:z.1f} m",
    )
    yield from _scale(tables, height - level)
    area = hull_area(ground[:, :2])
    if area:
        size = f"{size_text(area / _KILOMETRE2)} km²" if area > 0.1 * _KILOMETRE2 else f"{area:.0f} m²"
        yield Fact("Area", size, detail="hull of the ground points")


def _scale(tables: Tables, height: float) -> Iterator[Fact]:
    cameras, stations = part(tables, "cameras"), part(tables, "stations")
    known = numbers(cameras, "focal_length")
    if not len(known) or height <= 0.0:
        return
    focal_length = known[rows_of(texts(cameras, "camera"), texts(stations, "camera"))]
    scale = 1000.0 * height / float(np.median(focal_length))
    sigma = float(part(tables, "options")["plate_sigma"])
    rounded = round(scale, 1 - len(f"{scale:.0f}") + 2)
    detail = f"{sigma / MICROMETRE:g} µm, the sigma of plate coordinates, are {sigma * scale / 1000.0:.3f} m there"
    yield Fact("Scale of the photos", f"1 : {rounded:,.0f}", detail=detail)


def hull_area(places: FloatArray) -> float:
    """Return the area (m2) of the convex hull of places (n, 2), which their triangles fill; 0 of a line."""
    from matplotlib.tri import Triangulation  # loaded for the pictures; scipy's hull is a quarter of all loading

    try:
        corners = places[Triangulation(*(places - places.mean(axis=0)).T).triangles]
    except (RuntimeError, ValueError):  # fewer than three points, or all on a line
        return 0.0
    (x1, y1), (x2, y2) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    return float(0.5 * np.abs(x1 * y2 - x2 * y1).sum())


def _times_fact(tables: Tables) -> Iterator[Fact]:
    """Yield when the photos were taken, as far as the deck says it."""
    stations = part(tables, "stations")
    time, days = numbers(stations, "time"), sorted({str(day) for day in stations.get("tide_day", ()) if day})
    known = time[np.isfinite(time)]
    if len(known):
        span = f"{known.min():z.1f} to {known.max():z.1f} s"
        detail = f"on the clock of the deck, {(known.max() - known.min()) / 60.0:.1f} minutes"
        yield Fact("Exposures", span, detail=detail)
    if days:
        shown = ", ".join(days[:4]) + (f" and {len(days) - 4} more" if len(days) > 4 else "")
        yield Fact("Days of exposure", shown)
    tide = numbers(part(tables, "adjusted_water"), "tide")
    tide = tide[np.isfinite(tide)]
    if len(tide):
        span = f"{tide.min():z.3f} to {tide.max():z.3f} m"
        yield Fact("Water levels at the exposures", span if np.ptp(tide) else f"{tide[0]:z.3f} m")


def _rays_table(tables: Tables) -> Iterator[PageTable]:
    """Yield how many points are measured on how many photos, dry and submerged, where there are points."""
    points = part(tables, "points")
    wet = Counter(zip(points["rays"], points["bathymetric"], strict=True))
    rays = sorted({number for number, _ in wet})
    if rays:
        yield page_tables.page_table(
            "Rays To Ground Points",
            [
                ("Rays", "I4", rays),
                ("Dry points", "I8", [f"{wet[n, False]:,}" for n in rays]),
                ("Submerged points", "I8", [f"{wet[n, True]:,}" for n in rays]),
            ],
            note="Plate measurements from which the position of a point comes.",
            folded=len(rays) > 8,
        )
