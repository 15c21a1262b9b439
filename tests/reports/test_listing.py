"""The listing as a whole: paper, order, stability, and that its numbers are those of the solution."""

import dataclasses
import datetime
import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from adjustment.test_free_network import free_block
from altered import altered
from asa_printer import played
from blocks import converged
from musatpy import adjust, model, read_deck
from musatpy.model.tables import empty
from musatpy.reports.listing import in_columns, listing, printed
from musatpy.reports.pages import PAGE_LINES, PAGE_WIDTH
from reference.networks import Plan
from sample_solutions import sample_solution

ST_THOMAS = Path(__file__).parents[2] / "fixtures" / "st_thomas" / "st_thomas.crd"
CASES = [(system, refraction) for system in model.CoordinateSystem for refraction in model.Refraction]


def listing_of(statistics, *, brief=False):
    """The listing of a solution whose statistics exist already."""
    shown, sections = in_columns(statistics, brief=brief)
    return "".join(printed(shown, sections, carriage_control=False, date=None))


def pages_of(text):
    return [page.split("\n") for page in text.rstrip("\n").split("\n\f")]


def section(text, title):
    """Return the lines below a title, up to two blank lines or the end of the page."""
    lines = next(page for page in pages_of(text) if title in page)
    rest = "\n".join(lines[lines.index(title) + 1 :])
    return rest.strip("\n").split("\n\n\n")[0].split("\n")


@pytest.mark.parametrize(("system", "refraction"), CASES)
def test_pages_fit_the_paper(system, refraction):
    text = listing(sample_solution(system, refraction))
    for number, page in enumerate(pages_of(text), start=1):
        assert len(page) <= PAGE_LINES
        assert max(map(len, page)) <= PAGE_WIDTH
        assert page[0].endswith(f"PAGE {number:6d}")
        assert len(page[0]) == PAGE_WIDTH
        assert page[1] == ""
    assert "nan" not in text
    assert text.isascii()


@pytest.mark.parametrize(
    ("title", "column"),
    [
        ("Statistics: Check Points Against Their Own Covariance", -1),
        ("Statistics: Global Unknowns", -1),
        ("Statistics: Variance Inflation Of Stations", slice(1, None)),
        ("Statistics: Error Ellipses Of Stations", slice(1, None, 3)),
        ("Statistics: Error Ellipses Of Ground Points, The 20 Largest", slice(1, None, 3)),
    ],
)
def test_what_is_worst_comes_first(title, column):
    rows = [line.split() for line in section(listing(sample_solution(model.CoordinateSystem.LOCAL)), title)]
    start = next(i for i, row in enumerate(rows) if row and row[0].startswith("--")) + 1
    rows = rows[start : rows.index([]) if [] in rows[start:] else None]
    if column == -1:
        worth = [float(row[-1]) for row in rows]
        worth = [-one for one in worth] if "Check" in title else worth
    elif "Inflation" in title:
        worth = [max(map(float, row[column])) for row in rows]
    else:
        worth = [math.hypot(*map(float, row[column])) for row in rows]  # major axis and sigma upwards
    assert len(worth) > 1
    # printed to a millimetre, or a tenth
    assert all(one >= other - 2e-3 for one, other in itertools.pairwise(worth))


def test_the_tilt_on_the_water_card_has_a_line_of_its_own():
    water = {"sigma": 0.004, "tilt_north": -1e-3, "tilt_sigma": 5e-5}
    text = listing(altered(sample_solution(model.CoordinateSystem.LOCAL), block={"water": water}))
    line = "Tilt of the water on its card .................... .000 arc seconds towards east, "
    assert f"{line}-206.265 towards north, sigma 10.313\n" in text


OPTIONS = [
    *(model.Program, model.Initial, model.Refraction, model.Weights, model.WaterLevel, model.Datum, model.Editing)
]


@pytest.mark.parametrize("place", range(6))
def test_the_lines_of_all_options_fit_the_paper(place):
    """Of each option its value at one place of the list of its values."""
    solution = sample_solution(model.CoordinateSystem.GEOGRAPHIC)
    given = {field.name: getattr(solution.block.options, field.name) for field in dataclasses.fields(model.Options)}
    changes = {
        name: [*type(option)][place % len(type(option))]
        for name, option in given.items()
        if type(option) in OPTIONS
    }
    text = listing(altered(solution, block={"options": lambda options: dataclasses.replace(options, **changes)}))
    assert len(changes) >= len(OPTIONS)
    assert max(map(len, text.replace("\f", "").splitlines())) <= PAGE_WIDTH


@pytest.mark.parametrize("system", model.CoordinateSystem)
def test_nothing_overflows_in_a_plausible_job(system):
    lines = [line for page in pages_of(listing(sample_solution(system))) for line in page[1:]]
    assert not [
        line for line in lines if "**" in line and "****" not in line and not line.startswith(("1053", "**"))
    ]
    assert sum("****" in line for line in lines) == 3  # the stars of the plate residuals


def test_carriage_control_prints_the_same_pages():
    solution = sample_solution()
    plain, controlled = listing(solution), listing(solution, carriage_control=True)
    assert played(controlled) == pages_of(plain)
    assert max(map(len, controlled.splitlines())) <= 1 + PAGE_WIDTH


def test_a_date_is_printed_on_every_page_when_asked_for():
    dated = listing(sample_solution(), date=datetime.date(1983, 11, 30))
    assert all("1983-11-30" in page[0] for page in pages_of(dated))
    undated = dated.replace("1983-11-30", " " * 10)
    assert undated == listing(sample_solution())


def test_a_job_without_extras_has_no_empty_tables():
    """A free network of images alone."""
    free = altered(free_block(Plan(photos_per_strip=4)), control=empty(model.Control), titles=("IMAGES",))
    text = listing(converged(free))
    absent = ("Tides", "Control Residuals", "Check Point", "Equal Elevation", "Air Bases\n", "Bathymetric")
    assert not [title for title in absent if title in text]
    assert section(text, "Ground Point Analysis")[6].split() == ["Sample", "Size", "0", "0", "0"]


def test_long_reasons_are_wrapped_not_cut():
    words = [f"word{number}" for number in range(60)]
    solution = dataclasses.replace(sample_solution(), warnings=(" ".join(words),))
    assert " ".join(section(listing(solution), "Warnings")).split() == ["-", *words]


def test_what_moved_most_is_not_named_where_the_movement_prints_as_zero():
    """Which photo moved by 1e-9 m depends on the machine; the listing must not."""
    lines = section(listing(sample_solution()), "Iterations")
    assert lines[3].split() == ["0", "1", "1488.5000", "841", "66.72000", "846", "4200000.00", ".10E-02"]
    assert lines[7].split() == ["1", "2", ".0000", ".00000", "291.70", ".00E+00"]


@pytest.mark.parametrize("noise", [1e-11, -1e-11])
def test_statistics_of_rounding_errors_do_not_depend_on_the_machine(noise):
    solution = sample_solution()
    shift = np.zeros((10, 3))
    shift[3 if noise > 0 else 7] = noise
    residual = np.full_like(solution.plates.residual, 1e-9) * (1.0 + shift[solution.block.plates.photo, :2])
    attitude = solution.block.photos.attitude + shift
    text = listing(altered(solution, stations={"attitude": attitude}, plates={"residual": residual}))
    rows = section(text, "Camera Station Attitude Analysis")
    assert rows[-3].split() == ["Maximum", "Difference"] + ["0", "0", ".000"] * 3
    assert rows[-2].split() == ["Camera", "with", "Max.", "Difference"]
    assert "****" not in text


def test_frames_go_across_in_groups_of_ten():
    def repeated(table, names):
        return {name: getattr(table, name)[np.arange(23) % 10] for name in names}

    solution = sample_solution()
    photos, names = solution.block.photos, [f"F{number}" for number in range(23)]
    columns = repeated(photos, (one.name for one in dataclasses.fields(photos))) | {"ids": names}
    stations = repeated(solution.stations, ("position", "attitude", "covariance"))
    text = listing(altered(solution, block={"photos": columns}, stations=stations, dependence=None, water=None))
    frames = [line.split()[1:] for line in text.splitlines() if line.startswith("Frame ") and "With" not in line]
    assert frames == [names[:10], names[10:20], names[20:]]


@pytest.mark.parametrize("refraction", [model.Refraction.NONE, model.Refraction.RIGOROUS])
def test_a_run_without_refraction_prints_no_refracted_points(refraction):
    text = listing(sample_solution(refraction=refraction))
    head = section(text, "Bathymetric Points")[3]
    depths = section(text, "Depths Of Bathymetric Points")[0]
    assert ("  Refraction" in head.replace("No Refraction", "")) == (refraction is not model.Refraction.NONE)
    assert ("Depth, refraction" in depths) == (refraction is not model.Refraction.NONE)


def test_the_echo_has_all_decimals_of_a_card(tmp_path):
    """Those of its edit at least; of angles those of the seconds; no more than there are."""
    text = ST_THOMAS.read_text().replace("TID 21           0.1200", "TID 21          0.12345")
    text = text.replace("   5.00 ", "  2.125 ", 1).replace("  0.43702 ", " 0.437025 ", 1)
    (tmp_path / "deck.crd").write_text(text)
    echoed = listing(adjust(read_deck(tmp_path / "deck.crd")))
    assert "2.125" in section(echoed, "Input: Options (OPT)")[-1].split()
    tides = [line.split() for line in section(echoed, "Input: Tide (TID)")[-3:]]
    assert tides == [["21", ".12345"], ["22", ".31000"], ["23", "-.08000"]]
    stations = [line.split() for line in section(echoed, "Input: Exposure station, geographic (STA)")[-3:]]
    assert [row[4] for row in stations] == ["21.71281", "24.29574", "24.46428"]
    assert [row[7] for row in stations] == ["36.948780", "47.862690", ".437025"]
