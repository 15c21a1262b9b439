"""The legacy listings against the cleaned tables of the report, cell by cell, where these are at hand."""

from __future__ import annotations

import csv
import re

import pytest

from listings.audit.report_tables import cleaned, table
from musatpy.listings.audit.reading import read_listing

ROWS = {
    "sum_of_differences": "sum",
    "mean_of_differences": "mean",
    "rms_of_differences": "rms",
    "std_dev_from_mean": "deviation",
    "maximum_difference": "maximum",
}


def rows_of(number):
    with open(cleaned(number), newline="", encoding="utf-8") as file:
        title = next(file)
        return title, list(csv.DictReader(file))


def as_fields(text):
    """Return the fields of a number without leading zeros: `-0 08 46.908` and `-0 8 46.908` are one."""
    return re.sub(r" 0(\d)", r" \1", text)


@pytest.mark.parametrize("number", [1, 2, 3, 5, 6, 7])
def test_every_cell_of_an_analysis(number):
    title, rows = rows_of(number)
    (analysis,) = read_listing(table(number)).analyses
    assert analysis.refracted == ("Modified" in title)
    cells = 0
    for row in rows:
        name = row.pop("row")
        for text, component in zip(row.values(), analysis.components, strict=True):
            if name == "sample_size":
                assert component.size == int(text)
            elif name == "id_with_max":
                assert component.maximum_id == text.removesuffix("?")  # 12110 is not excluded
            else:
                assert as_fields(component.statistics[ROWS[name]].text) == as_fields(text), (name, component.name)
            cells += 1
    assert cells == 21


@pytest.mark.parametrize("number", [4, 8])
def test_every_cell_of_the_plate_residuals(number):
    _, rows = rows_of(number)
    (plates,) = read_listing(table(number)).plates
    assert plates.frames == tuple(row["frame"] for row in rows) and len(rows) == 10
    for row in rows:
        for (group, axis), cells in plates.rms.items():
            assert cells[row["frame"]].value == float(row[f"rms_{group}_{axis}"])
        for group, stars in plates.stars.items():
            assert (row["frame"] in [frame for frame, _ in stars]) == (row[f"flag_max_{group}"] == "****")


def test_every_cell_of_the_bathymetric_points():
    _, rows = rows_of(9)
    (points,) = (one.points for one in read_listing(table(9)).submerged)
    assert [(point.name, point.mark) for point in points] == [(row["point"], row["note"]) for row in rows]
    names = {"none": "no_refraction", "predicted": "predicted", "refraction": "refraction"}
    for point, row in zip(points, rows, strict=True):
        assert {cell.text for cell in point.xyz.values()} and len(point.xyz) == 9
        for (column, axis), cell in point.xyz.items():
            assert cell.text == row[f"{axis}_{names[column]}"], (point.name, column, axis)
