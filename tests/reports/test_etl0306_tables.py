"""The printed Tables 6-1 to 6-9 of ETL-0306, from solutions built to have their sums, RMS and maxima."""

import csv
import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from musatpy.model import CoordinateSystem, PlateResiduals, Refraction
from musatpy.reports.listing import listing
from musatpy.units import ARC_SECOND
from sample_solutions import PHOTOS, sample_solution

FIXTURES = Path(__file__).parents[2] / "fixtures" / "etl0306"
STATISTICS = ("sum_of_differences", "mean_of_differences", "rms_of_differences", "std_dev_from_mean")
STATISTICS += ("maximum_difference", "id_with_max")
LABELS = ("Sum of Differences", "Mean Value of Differences", "RMS of Differences", "Standard Deviation from Mean")
LABELS += ("Maximum Difference", " with Max. Difference")

# Cells that contradict the others of their column (fixtures/etl0306/README.md). Of the two of Table 6-3, the RMS is
# taken as right.
MISPRINTS = {
    ("6.3", "latitude", "std_dev_from_mean"),
    ("6.5", "latitude", "mean_of_differences"),
    ("6.6", "x_tilt", "mean_of_differences"),
    ("6.6", "heading", "mean_of_differences"),
}

ANALYSES = {
    "6.1": ("Camera Station Position Analysis", Refraction.NONE),
    "6.2": ("Camera Station Attitude Analysis", Refraction.NONE),
    "6.3": ("Ground Point Analysis", Refraction.NONE),
    "6.5": ("Camera Station Position Analysis", Refraction.WATPT),
    "6.6": ("Camera Station Attitude Analysis", Refraction.WATPT),
    "6.7": ("Ground Point Analysis", Refraction.WATPT),
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


def value_of(printed):
    """Return arc seconds of a printed `-0 8 46.908`, or the number itself."""
    parts = printed.split()
    if len(parts) == 1:
        return float(parts[0])
    magnitude = abs(int(parts[0])) * 3600 + int(parts[1]) * 60 + float(parts[2])
    return -magnitude if parts[0].startswith("-") else magnitude


def deviation(N, total, rms):
    return math.sqrt((N * rms**2 - total**2 / N) / (N - 1))


def sample_of(unit, N, cells, wanted):
    """Return N differences with the printed sum, maximum and RMS, each within its rounding.

    Within the rounding of the sum and the RMS, the pair is taken whose mean and standard deviation round to the
    printed ones, as far as those are `wanted`; raises `LookupError` where there is none.
    """
    half = 0.0005 if unit == "dms" else 0.005
    total, rms, maximum = (value_of(cells[name]) for name in (STATISTICS[0], STATISTICS[2], STATISTICS[4]))
    steps = np.linspace(-0.96, 0.96, 49) * half  # 0 among them
    for S, R in itertools.product(sorted(total + steps, key=lambda s: abs(s - total)), rms + steps):
        mean_fits = abs(S / N - value_of(cells["mean_of_differences"])) < 0.96 * half
        spread = deviation(N, S, R)
        deviation_fits = abs(spread - value_of(cells["std_dev_from_mean"])) < 0.96 * half
        if "mean_of_differences" in wanted and not mean_fits:
            continue
        if "std_dev_from_mean" in wanted and not deviation_fits:
            continue
        sample = _solve(N, S, R, maximum)
        if sample is not None:
            return sample
    raise LookupError("no sample has the printed statistics")


def _solve(N, S, R, maximum):
    """Return N numbers of sum S and RMS R, the first the maximum and the others smaller; None where impossible."""
    rest, square = S - maximum, N * R**2 - maximum**2
    centre = rest / (N - 1)
    variance = square / (N - 1) - centre**2
    if variance < 0.0:
        return None
    # A few far from the centre and the others opposite: with k of N-1 at centre + a, the rest at centre - b.
    for k in range(1, N - 1):
        a = math.sqrt(variance * (N - 1 - k) / k)
        b = a * k / (N - 1 - k)
        sample = np.concatenate([[maximum], np.full(k, centre + a), np.full(N - 1 - k, centre - b)])
        if np.abs(sample[1:]).max() < abs(maximum):
            return sample
    return None


def built_solution(table, samples):
    """Return a solution with the samples as differences, the maximum at the printed photo or point."""
    title, refraction = ANALYSES[table]
    solution = sample_solution(refraction=refraction)
    block = solution.block
    units = [ARC_SECOND if unit == "dms" else 1.0 for unit, _, _ in printed_cells(table).values()]
    if "Ground" in title:
        return _with_ground(solution, samples, units)
    shift = np.zeros((len(PHOTOS), 3))
    for axis, (sample, name) in enumerate(samples):
        place = PHOTOS.index(name)
        shift[:, axis] = np.insert(sample[1:], place, sample[0]) * units[axis]
    stations = solution.stations
    if "Attitude" in title:
        stations = dataclasses.replace(stations, attitude=block.photos.attitude + shift)
    else:
        stations = dataclasses.replace(stations, position=block.photos.position + shift)
    return dataclasses.replace(solution, stations=stations)


def _with_ground(solution, samples, units):
    control = solution.block.control
    horizontal, vertical = np.flatnonzero(control.known[:, 0]), np.flatnonzero(control.known[:, 2])
    horizontal, vertical = horizontal[:7], vertical[:35]  # the full point of the sample solution has no position
    position, ids = solution.points.position.copy(), solution.block.points.ids.copy()
    ids[:] = [f"P{number}" for number in range(len(ids))]
    for axis, (sample, name) in enumerate(samples):
        rows = vertical if axis == 2 else horizontal
        place = axis  # latitude and longitude have different points
        ids[control.point[rows[place]]] = name
        position[control.point[rows], axis] = (
            control.position[rows, axis] + np.insert(sample[1:], place, sample[0]) * units[axis]
        )
    block = dataclasses.replace(solution.block, points=dataclasses.replace(solution.block.points, ids=ids))
    return dataclasses.replace(
        solution, block=block, points=dataclasses.replace(solution.points, position=position)
    )


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
def test_every_consistent_cell_of_an_analysis(table):
    samples, columns = [], printed_cells(table)
    for component, (unit, N, cells) in columns.items():
        wanted = [name for name in STATISTICS if (table, component, name) not in MISPRINTS]
        samples.append((sample_of(unit, N, cells, wanted), cells["id_with_max"]))
    title, _ = ANALYSES[table]
    section = printed_section(listing(built_solution(table, samples)), title)
    assert cells_of(section, "Sample Size") == [str(N) for _, N, _ in columns.values()]
    for statistic, label in zip(STATISTICS, LABELS, strict=True):
        for printed, (component, (_, _, cells)) in zip(cells_of(section, label), columns.items(), strict=True):
            if (table, component, statistic) in MISPRINTS:
                assert printed != cells[statistic]
            else:
                assert printed == cells[statistic], (component, statistic)


@pytest.mark.parametrize(("table", "kind"), [("6.1", "Standard"), ("6.5", "Modified")])
def test_titles_say_which_run_it_was(table, kind):
    section = printed_section(listing(sample_solution(refraction=ANALYSES[table][1])), ANALYSES[table][0])
    correction = "Refraction Correction Applied" if kind == "Modified" else "No Refraction Correction"
    assert section[1:4] == [f"{kind} MUSAT-IIA", correction, "(Degrees, Minutes, Seconds)"]


def plate_rows(table):
    with open(FIXTURES / "plate_residuals.csv", newline="") as file:
        return [row for row in csv.DictReader(file) if row["table"] == table]


# Points of each frame, triangulated and not, that fit the printed RMS of all points.
POINTS = {"841": (22, 1), "842": (22, 2), "843": (22, 3), "844": (24, 3)}


@pytest.mark.parametrize(("table", "refraction"), [("6.4", Refraction.NONE), ("6.8", Refraction.WATPT)])
def test_plate_residuals_of_all_frames(table, refraction):
    photo, residual, triangulated = [], [], []
    for number, row in enumerate(plate_rows(table)):
        trig, other = POINTS.get(row["frame"], (20, 0))
        signs = np.where(np.arange(trig + other) % 2, 1.0, -1.0)
        size = [[float(row["rms_trig_x"]), float(row["rms_trig_y"])]] * trig
        size += [[float(row["rms_nontrig_x"]), float(row["rms_nontrig_y"])]] * other
        photo += [number] * (trig + other)
        residual += list(np.array(size) * signs[:, None])
        triangulated += [True] * trig + [False] * other
    section = printed_section(listing(_with_plates(refraction, photo, residual, triangulated)), "Plate Residuals")
    names = ("rms_trig_x", "rms_trig_y", "rms_nontrig_x", "rms_nontrig_y", "rms_all_x", "rms_all_y")
    rows = [line for line in section if line.startswith("RMS")]
    for name, line in zip(names, rows, strict=True):
        assert line[38:].split() == [row[name].lstrip("0") for row in plate_rows(table)], name
    stars = [line for line in section if line.startswith("Frame With Max.")]
    for name, line in zip(("flag_max_trig", "flag_max_nontrig", "flag_max_all"), stars, strict=True):
        cells = [line[38:].ljust(90)[9 * frame : 9 * frame + 9].strip() for frame in range(10)]
        assert cells == [row[name] for row in plate_rows(table)], name


def _with_plates(refraction, photo, residual, triangulated):
    solution = sample_solution(refraction=refraction)
    m = len(photo)
    plates = dataclasses.replace(
        solution.block.plates,
        photo=photo,
        point=np.arange(m) % 98,
        xy=np.zeros((m, 2)),
        sigma=np.full((m, 2), 0.01),
        triangulated=triangulated,
    )
    return dataclasses.replace(
        solution,
        block=dataclasses.replace(solution.block, plates=plates),
        plates=PlateResiduals(residual=residual, triangulated=triangulated, correction=np.zeros((m, 2))),
    )


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
