"""Solutions as frames, as a dataset, and in a notebook: what the record says, cell by cell."""

import itertools
import math
import re
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import musatpy
from altered import altered
from musatpy import adjust, read_deck, to_html, to_pandas, to_xarray
from musatpy.errors import MusatError
from musatpy.model import CoordinateSystem
from musatpy.model.tables import Table, empty, stacked
from musatpy.notebook.frames import FIRST
from musatpy.reports.record import record, record_of
from musatpy.statistics import Statistics
from page.pages import Reader
from record_rows import with_rows
from sample_solutions import sample_solution

FIXTURES = Path(__file__).parents[2] / "fixtures"
DECKS = ["st_thomas/st_thomas.crd", "st_thomas_raw/st_thomas_raw.crd"]


@cache
def solution_of(deck):
    return adjust(read_deck(FIXTURES / deck))


def same(shown, recorded):
    if recorded is None:
        return shown is None or shown == "" or math.isnan(shown)
    if isinstance(recorded, list):
        return len(shown) == len(recorded) and all(map(same, shown, recorded))
    if isinstance(recorded, float):
        return math.isclose(shown, recorded, rel_tol=1e-11)  # of the digits that a record has
    return bool(shown == recorded)


def entry_at(entry, head):
    """Return the component of an entry of the record that a column of a frame is: `position[2]`, `[images]`."""
    for step in re.findall(r"\[([^\]]+)\]", head):
        if entry is not None:
            entry = entry.get(step, 0) if isinstance(entry, dict) else entry[int(step)]
    return entry


def holds(frame, table):
    """Hold a frame against the columns of a table of the record, and return how many cells it has."""
    for name, column in table.items():
        heads = [head for head in frame if head == name or head.startswith(f"{name}[")]
        assert heads or not any(column), name
        for head in heads:
            cells = zip(frame[head].tolist(), column, strict=True)
            assert all(same(shown, entry_at(entry, head)) for shown, entry in cells), head
    return frame.size


def is_table(value):
    return isinstance(value, dict) and bool(value) and all(isinstance(column, list) for column in value.values())


def in_columns(rows):
    """Return rows of the record as columns."""
    return {name: [row[name] for row in rows] for name in rows[0]}


@pytest.mark.parametrize("deck", DECKS)
def test_frames_hold_every_table_of_the_record(deck):
    solution = solution_of(deck)
    frames, said = to_pandas(solution), record_of(Statistics(solution))
    cells = sum(holds(frames[name], table) for name, table in said.items() if is_table(table) and name in frames)
    assert cells > 3000
    for name in ("iterations", "water_passes"):
        assert holds(frames[name], in_columns(said[name]))
    for name in ("options", "solution", "verdict"):
        plain = {key: [value] for key, value in said[name].items() if key != "reasons"}
        assert holds(frames[name], plain)
    assert holds(frames["tests.check_points"], said["tests"]["check_points"])
    assert holds(frames["plate_statistics.frames"], said["plate_statistics"]["frames"])


def test_tables_within_rows_have_the_name_of_their_owner():
    solution = solution_of(DECKS[1])
    plates = record(solution)["reduction"]["plates"]
    marks = [{"photo": plate["photo"], **mark} for plate in plates for mark in with_rows(plate["marks"])]
    numbers = [
        {"step": step["step"], **number}
        for plate in plates
        for step in plate["steps"]
        for number in step["parameters"]
    ]
    frames = to_pandas(solution)
    assert len(marks) > 10 and holds(frames["reduction.plates.marks"], in_columns(marks))
    assert len(numbers) > 10 and holds(frames["reduction.plates.steps.parameters"], in_columns(numbers))


def test_frames_have_types_and_units():
    frames = to_pandas(solution_of(DECKS[0]))
    assert frames["stations"].attrs["units"]["attitude[2]"] == "rad"
    assert frames["points"]["sigma[0]"].dtype == np.float64
    assert frames["points"]["bathymetric"].dtype == np.bool_
    assert frames["points"]["rays"].dtype == np.int64
    assert len(frames["lenses"]) == 0 and "k0" in frames["lenses"]
    assert frames["equal_elevations"]["points"].iloc[0] == ["202", "205", "208"]


def test_a_frame_of_one_table_has_plain_names():
    solution = solution_of(DECKS[0])
    frames = to_pandas(solution)
    for name in FIRST:
        plain = solution.to_pandas(name)
        assert len(plain) == len(frames[name]) and plain.shape == frames[name].shape
        assert not [column for column in plain if "[" in column]
        assert set(plain.attrs["meanings"]) == set(plain)
    points, stations = solution.to_pandas("points"), solution.to_pandas("stations")
    assert points.columns[6:12].tolist() == ["x", "y", "z", "sigma_x", "sigma_y", "sigma_z"]
    assert points["x"].between(-65.0, -64.8).all() and points["y"].between(18.2, 18.4).all()  # St. Thomas
    assert points["sigma_y"].equals(frames["points"]["sigma[1]"].rename("sigma_y"))
    assert points["covariance_x_z"].equals(frames["points"]["covariance[0][2]"].rename("covariance_x_z"))
    assert np.allclose(np.radians(stations["heading"]), frames["stations"]["attitude[2]"], rtol=1e-14)
    assert {"given_x", "sigma_x_tilt", "given_sigma_heading", "covariance_z_x_tilt"} <= set(stations)
    assert stations.attrs["units"]["heading"] == "deg" and points.attrs["units"]["sigma_x"] == "m"
    assert [points.attrs["units"][name] for name in "xyz"] == ["deg", "deg", "m"]
    assert {"difference_x", "used_z"} <= set(solution.to_pandas("control"))
    assert {"x", "y", "residual_x"} <= set(solution.to_pandas("plates"))
    assert solution.to_pandas("tests.check_points").columns[0] == "point"


def test_axes_of_plain_names_are_those_of_the_job():
    local = adjust(read_deck(FIXTURES / "verdict/iiia_false_minimum.crd"))
    points, frame = local.to_pandas("points"), to_pandas(local)["points"]
    assert points["x"].equals(frame["position[0]"].rename("x")) and points.attrs["units"]["x"] == "m"
    geocentric = sample_solution(CoordinateSystem.GEOCENTRIC).to_pandas("points")
    assert {"x", "y", "z", "sigma_east", "sigma_north", "sigma_up"} <= set(geocentric)
    assert "sigma_x" not in geocentric


def test_a_table_that_is_not_there_is_said_with_those_that_are():
    with pytest.raises(MusatError, match=r"no table 'point'; there are points, stations, .*of the record"):
        solution_of(DECKS[0]).to_pandas("point")


def test_all_that_the_record_states_is_a_column():
    frames = to_pandas(solution_of(DECKS[0]))
    names = {name.partition(".")[0] for name in frames} - {"record"}
    names |= {head.partition("[")[0] for head in frames["record"]}
    assert set(record_of(Statistics(solution_of(DECKS[0])))) <= names
    flat = [f"{name}.{column}".replace(".", "_") for name, frame in frames.items() for column in frame]
    assert len(set(flat)) == len(flat)


@pytest.mark.parametrize("deck", DECKS)
def test_a_dataset_holds_what_the_frames_hold(deck):
    solution = solution_of(deck)
    dataset, frames = to_xarray(solution), to_pandas(solution)
    stations = frames["stations"]
    axes = np.stack([stations[f"position[{axis}]"] for axis in range(3)], axis=1)
    assert np.array_equal(dataset.stations_position, axes)
    covariance = frames["points"][[f"covariance[{i}][{j}]" for i, j in itertools.product(range(3), repeat=2)]]
    assert np.array_equal(dataset.points_covariance, covariance.to_numpy().reshape(-1, 3, 3), equal_nan=True)
    assert float(dataset.solution_sigma0) == frames["solution"]["sigma0"].iloc[0]
    assert dataset.plates_point.values.tolist() == frames["plates"]["point"].tolist()
    assert float(dataset.stations_tide.sel(stations="22")) == stations.set_index("photo")["tide"]["22"]
    assert "distances_length" not in dataset


def test_a_dataset_has_units_and_meanings():
    dataset = to_xarray(solution_of(DECKS[0]))
    assert dataset.stations_attitude.attrs == {"units": "rad", "long_name": "adjusted"}
    assert dataset.plates_residual.attrs["units"] == "mm"
    assert dataset.observations_of.values[0] == "21 102"
    assert np.isnan(dataset.adjusted_water_tilt_sigma).all()


@pytest.mark.slow
def test_a_dataset_survives_its_file(tmp_path):
    import xarray

    dataset = to_xarray(solution_of(DECKS[1]))
    dataset.to_netcdf(tmp_path / "run.nc", engine="scipy")
    assert xarray.load_dataset(tmp_path / "run.nc", engine="scipy").identical(dataset)


def test_lists_of_different_lengths_end_in_nothing():
    block = read_deck(FIXTURES / DECKS[0])
    groups = block.equal_elevations
    point = [*groups.point, 0]
    more = replace(
        groups, ids=[*groups.ids, "L"], sigma=[*groups.sigma, 0.1], group=[*groups.group, 1], point=point
    )
    solution = altered(
        solution_of(DECKS[0]),
        block=replace(block, equal_elevations=more),
        levels=[1.0, 2.0],
        level_sigmas=[0.1, 0.1],
    )
    differences = to_xarray(solution).equal_elevations_difference.values
    assert differences.shape == (2, 3)
    assert np.isnan(differences[1]).tolist() == [False, True, True]


@pytest.mark.parametrize(("package", "function"), [("pandas", to_pandas), ("xarray", to_xarray)])
def test_a_missing_package_is_named_with_its_line(package, function, monkeypatch):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MusatError, match=rf"the package {package}: pip install 'musatpy\[notebook\]'"):
        function(solution_of(DECKS[0]))


def test_a_solution_has_its_tables_itself():
    solution = solution_of(DECKS[0])
    assert solution.to_pandas().keys() == to_pandas(solution).keys()
    assert solution.to_xarray().equals(to_xarray(solution))
    assert solution._repr_html_() == to_html(solution)
    assert solution.block._repr_html_() == to_html(solution.block)


def large(block, photos):
    """Return a block with the rows of another many times over, and names as long as can be."""
    times = photos // block.photos.count
    table = stacked([block.photos] * times)
    return replace(
        block,
        titles=("T" * 500,) * 20,
        photos=replace(table, ids=[f"{n:08d}" for n in range(table.count)]),
        plates=stacked([block.plates] * times),
    )


def test_what_python_prints_is_short():
    solution = solution_of(DECKS[0])
    block = large(solution.block, 1000)
    failed = altered(solution, converged=False, reason="no end " * 500, block=block)
    for shown in (solution, solution.block, block, failed):
        assert len(repr(shown)) <= 1000
    assert "sigma0=0.9361" in repr(solution) and "photos=3" in repr(solution) and "not converged" in repr(failed)
    assert repr(solution.block.points) == "Points(22: ids, bathymetric, dry)"


def test_no_table_prints_its_numbers():
    def kinds(kind):
        for one in kind.__subclasses__():
            yield one
            yield from kinds(one)

    assert len(list(kinds(Table))) > 25
    assert all(one.__repr__ is Table.__repr__ for one in kinds(Table))
    assert repr(empty(musatpy.model.Photos)).startswith("Photos(0: ids, camera")


def test_a_notebook_shows_verdict_stations_and_depths():
    page = Reader(to_html(solution_of(DECKS[0])))
    cells = {cell for rows in page.tables.values() for row in rows for cell in row}
    for said in ("ACCEPTED", "Adjusted Exposure Stations: Positions", "Depths Of Bathymetric Points"):
        assert said in page.text
    assert {"-64 56 36.59240", "5.349"} <= cells
    assert "22 rows, of which 12 are shown" in page.text


def test_names_of_a_deck_are_no_tags_and_a_page_is_small():
    solution = solution_of(DECKS[0])
    ids = solution.block.points.ids.astype("U40")
    ids[0] = "<img src=x onerror=alert(1)>"
    hostile = altered(solution, block={"titles": ("<script>&",) * 3000, "points": {"ids": ids}})
    doubtful = altered(hostile, warnings=tuple("<b>" * 1000 + str(n) for n in range(50)))
    page = to_html(doubtful)
    in_tables = {"table", "caption", "thead", "tbody", "tr", "th", "td"}
    assert {tag for tag, _ in Reader(page).tags} <= {"p", "strong", "br", "ul", "li"} | in_tables
    assert len(page) < 50_000
    assert len(to_html(large(solution.block, 1000))) < 50_000
