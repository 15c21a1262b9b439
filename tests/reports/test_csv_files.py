"""Tables as CSV: all that are printed, ids first, with the numbers and units of the record."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports.csv_files import csv_files
from musatpy.reports.listing import sections_of
from musatpy.reports.pages import Section
from musatpy.reports.record import record_of
from musatpy.runs import run_deck
from musatpy.statistics import Statistics
from record_rows import read_rows
from sample_solutions import sample_solution

FIXTURES = Path(__file__).parents[2] / "fixtures"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    run_deck(FIXTURES / "st_thomas" / "st_thomas.crd", folder, csv=True)
    return folder


def rows_of(folder, name):
    with (folder / "st_thomas_tables" / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize(
    ("name", "table", "columns"),
    [
        ("adjusted_ground_points", "points", {"Latitude (rad)": ("position", 0), "Sigma Up (m)": ("sigma", 2)}),
        ("adjusted_exposure_stations_attitudes", "stations", {"Heading (rad)": ("attitude", 2)}),
        ("input_plate_measurements", "plates", {"x (mm)": ("xy", 0), "sigma y (mm)": ("sigma", 1)}),
        ("residuals_of_plate_measurements_adjusted_minus_measured", "plates", {"Resid. x (mm)": ("residual", 0)}),
    ],
)
def test_numbers_are_those_of_the_record(run, name, table, columns):
    recorded = read_rows(run / "st_thomas.json")[table]
    rows = rows_of(run, name)
    assert len(rows) == len(recorded)
    for head, (field, component) in columns.items():
        written = sorted(float(row[head]) for row in rows)
        expected = sorted(row[field][component] for row in recorded)
        np.testing.assert_allclose(written, expected, rtol=1e-11, atol=0.0)  # records have twelve digits


def test_all_that_is_printed_below_a_rule_is_there(run):
    """The answer has its tables in full on later pages."""
    text = (run / "st_thomas.lst").read_text().split("Index Of Pages")[1]
    titles = set(re.findall(r"\n\n(\S[^\n]*)\n\n(?:[^\n]+\n){1,3}-+(?:  -+)+\n", text))
    titles = {re.sub(r": \d+$", "", title) for title in titles if not title.endswith("(continued)")}
    names = {"_".join(re.findall(r"[a-z0-9.]+", title.lower())) for title in titles}
    assert len(names) > 20 and names <= {path.stem for path in (run / "st_thomas_tables").iterdir()}


def test_ids_stand_first_and_heads_are_different(run):
    heads = (run / "st_thomas_tables" / "iterations.csv").read_text().splitlines()[0]
    assert heads.startswith("Pass,Iteration,Largest rotation (rad),Photo,Largest translation (m),Photo 2,")
    for path in (run / "st_thomas_tables").iterdir():
        heads = path.read_text().splitlines()[0]
        assert len(set(next(csv.reader([heads])))) == len(next(csv.reader([heads]))), path
    assert list(rows_of(run, "input_equal_elevations")[0]) == ["Group", "Point", "Sigma (m)"]


@pytest.mark.parametrize("system", CoordinateSystem)
@pytest.mark.parametrize("refraction", [Refraction.NONE, Refraction.RIGOROUS])
def test_every_system_has_its_tables(system, refraction):
    statistics = Statistics(sample_solution(system, refraction))
    files = csv_files(sections_of(statistics))
    rows = list(csv.reader(files["input_control.csv"].splitlines()))
    x = rows[0].index("Latitude (rad)" if system is CoordinateSystem.GEOGRAPHIC else "X (m)")
    recorded = [position[0] for position in record_of(statistics, {"control"})["control"]["given_position"]]
    np.testing.assert_array_equal([float(row[x] or "nan") for row in rows[1:]], np.array(recorded, dtype=float))


@pytest.mark.parametrize("name", ["=1+1", "+1+1", "-2+3", "@SUM", "\t=1", "-A", "+1e"])
def test_ids_that_a_spreadsheet_would_compute_stay_texts(name):
    """None of its four signs stands first, and who strips blanks reads the same id."""
    rows = [["Point", "X (m)"], [name, -1.25], ["-5", 3.0], ["P-1", np.inf]]
    (text,) = csv_files([Section(title="Points", values=lambda: rows)]).values()
    _, first, second, third = csv.reader(text.splitlines())
    assert first[0][0] == " " and first[0].strip() == name.strip() and first[1] == "-1.25"
    assert second == ["-5", "3.0"] and third == ["P-1", ""]  # a number is one in any sheet


def test_without_the_option_there_are_none(tmp_path):
    run_deck(FIXTURES / "cayman" / "cayman_modified.crd", tmp_path)
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".json", ".lst"]
