"""The printed Tables 6-1 to 6-9 of ETL-0306: their statistics, residuals and places print as they were printed."""

import csv
import dataclasses
from pathlib import Path

import numpy as np
import pytest

from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports.listing import listing
from musatpy.statistics import DifferenceStatistics, Statistics
from musatpy.units import ARC_SECOND
from reports.test_listing import listing_of
from sample_solutions import sample_solution

FIXTURES = Path(__file__).parents[2] / "fixtures" / "etl0306"
# Of a column of an analysis: what it is, as the fixture calls it, as the program does, and in print.
CELLS = (
    ("sum_of_differences", "sum", "Sum of Differences"),
    ("mean_of_differences", "mean", "Mean Value of Differences"),
    ("rms_of_differences", "rms", "RMS of Differences"),
    ("std_dev_from_mean", "deviation", "Standard Deviation from Mean"),
    ("maximum_difference", "maximum", "Maximum Difference"),
)
POSITIONS = ("station_positions", "Camera Station Position Analysis")
ATTITUDES = ("station_attitudes", "Camera Station Attitude Analysis")
GROUND = ("ground_points", "Ground Point Analysis")
ANALYSES = {
    "6.1": (*POSITIONS, Refraction.NONE),
    "6.2": (*ATTITUDES, Refraction.NONE),
    "6.3": (*GROUND, Refraction.NONE),
    "6.5": (*POSITIONS, Refraction.WATPT),
    "6.6": (*ATTITUDES, Refraction.WATPT),
    "6.7": (*GROUND, Refraction.WATPT),
}


def printed_cells(table):
    """Return component -> (unit, size, statistic -> printed text) of one analysis."""
    components = {}
    with open(FIXTURES / "analyses.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["table"] == table:
                unit, size, cells = components.get(row["component"], (row["unit"], int(row["size"]), {}))
                cells[row["statistic"]] = row["printed"]
                components[row["component"]] = (unit, size, cells)
    return components


def value_of(unit, printed):
    """Return the value of a cell, of `-0 8 46.908` in radians."""
    if unit != "dms":
        return float(printed)
    degrees, minutes, seconds = printed.split()
    size = abs(int(degrees)) * 3600 + int(minutes) * 60 + float(seconds)
    return (-size if degrees.startswith("-") else size) * ARC_SECOND


def printed_section(text, title):
    """Return the lines of a section, from its title to the second rule of equal signs."""
    lines = text.splitlines()
    start = lines.index(title)
    rules = [number for number, line in enumerate(lines) if number > start and line.startswith("====")]
    return lines[start : rules[1] + 1]


def cells_of(section, label):
    """Return the three cells of the row with a label, each as its printed words joined by one blank."""
    row = next(line for line in section if label in line[:36])
    return [" ".join(row[column : column + 18].split()) for column in (36, 54, 72)]


@pytest.mark.parametrize("table", ANALYSES)
def test_every_cell_of_an_analysis(table):
    """Of these statistics, misprints among them: which of them contradict their column is for the audit to say."""
    name, title, refraction = ANALYSES[table]
    statistics, columns = Statistics(sample_solution(refraction=refraction)), printed_cells(table)
    given = tuple(
        DifferenceStatistics(
            size=N,
            maximum_id=cells["id_with_max"],
            **{field: value_of(unit, cells[cell]) for cell, field, _ in CELLS},
        )
        for unit, N, cells in columns.values()
    )
    statistics.__dict__[name] = dataclasses.replace(getattr(statistics, name), statistics=given)
    section = printed_section(listing_of(statistics), title)
    assert cells_of(section, "Sample Size") == [str(N) for _, N, _ in columns.values()]
    for cell, label in [*((cell, label) for cell, _, label in CELLS), ("id_with_max", " with Max. Difference")]:
        assert cells_of(section, label) == [cells[cell] for _, _, cells in columns.values()], label


@pytest.mark.parametrize(("table", "kind"), [("6.1", "Standard"), ("6.5", "Modified")])
def test_titles_say_which_run_it_was(table, kind):
    _, title, refraction = ANALYSES[table]
    section = printed_section(listing(sample_solution(refraction=refraction)), title)
    correction = "Refraction Correction Applied" if kind == "Modified" else "No Refraction Correction"
    assert section[1:4] == [f"{kind} MUSAT-IIA", correction, "(Degrees, Minutes, Seconds)"]


def plate_rows(table):
    with open(FIXTURES / "plate_residuals.csv", newline="") as file:
        return [row for row in csv.DictReader(file) if row["table"] == table]


@pytest.mark.parametrize(("table", "refraction"), [("6.4", Refraction.NONE), ("6.8", Refraction.WATPT)])
def test_plate_residuals_of_all_frames(table, refraction):
    statistics = Statistics(sample_solution(refraction=refraction))
    kinds = ("trig", "nontrig", "all")
    rms = [[[float(row[f"rms_{kind}_{axis}"]) for axis in "xy"] for kind in kinds] for row in plate_rows(table)]
    largest = tuple(np.hypot(*np.moveaxis(rms, -1, 0)).argmax(axis=0).tolist())
    statistics.__dict__["plates"] = dataclasses.replace(statistics.plates, rms=np.array(rms), largest=largest)
    section = printed_section(listing_of(statistics), "Plate Residuals")
    names = ("rms_trig_x", "rms_trig_y", "rms_nontrig_x", "rms_nontrig_y", "rms_all_x", "rms_all_y")
    rows = [line for line in section if line.startswith("RMS")]
    for name, line in zip(names, rows, strict=True):
        assert line[38:].split() == [row[name].lstrip("0") for row in plate_rows(table)], name
    stars = [line for line in section if line.startswith("Frame With Max.")]
    for name, line in zip(("flag_max_trig", "flag_max_nontrig", "flag_max_all"), stars, strict=True):
        cells = [line[38:].ljust(90)[9 * frame : 9 * frame + 9].strip() for frame in range(10)]
        assert cells == [row[name] for row in plate_rows(table)], name


def test_bathymetric_points_of_table_6_9():
    with open(FIXTURES / "bathymetric.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    kinds = ("no_refraction", "predicted", "refraction")
    xyz = np.array([[[float(row[f"{axis}_{kind}"]) for axis in "XYZ"] for kind in kinds] for row in rows])
    solution = sample_solution(CoordinateSystem.GEOCENTRIC)
    position = solution.points.position.copy()
    position[solution.bathymetric.point] = xyz[:, 2]
    solution = dataclasses.replace(
        solution,
        points=dataclasses.replace(solution.points, position=position),
        bathymetric=dataclasses.replace(solution.bathymetric, apparent=xyz[:, 0], predicted=xyz[:, 1]),
    )
    lines = listing(solution).splitlines()
    start = lines.index("Bathymetric Points")
    assert lines[start + 1] == "Comparison of Computed Geocentric Coordinates (M)"
    body = [line.split() for line in lines[start + 6 : start + 6 + 4 * len(rows)]]
    for number, row in enumerate(rows):
        printed = body[4 * number : 4 * number + 3]
        for axis, words in zip("XYZ", printed, strict=True):
            name = [row["point"], *filter(None, [row["note"]])] if axis == "Y" else []
            assert words == [*name, axis, *(row[f"{axis}_{kind}"] for kind in kinds)]
