"""Every picture of a run: what it shows and says, records that lack something, and signs drawn in one stroke."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from musatpy.canvas import svg
from musatpy.plots import gallery, panel
from musatpy.plots.gallery import GALLERY, marks, rendered
from musatpy.plots.gnss import observed_stations
from musatpy.plots.mean_residuals import mean_residuals
from musatpy.plots.painted import add_arrows, add_names, arrow_corners
from musatpy.plots.picture import Picture
from musatpy.plots.plan import block_plan
from musatpy.plots.profile import profile
from musatpy.plots.records import needs_of
from musatpy.plots.tables import SharedTables, worked_out_once
from plots.plot_records import gnss_block, st_thomas

BY_NAME = {picture.name: picture for picture in GALLERY}
_UNITS = re.compile(
    r", m$|, mm$|sigma$|residuals$|depth, m|by, m|photo$|correlation$|factor$|distribution$|cell$|^$"
)


@pytest.fixture(scope="module")
def block(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    return gnss_block(tmp_path_factory.getbasetemp())


@pytest.mark.slow
@pytest.mark.parametrize("picture", GALLERY, ids=list(BY_NAME))
def test_a_picture_has_the_same_bytes_again_and_units_on_its_axes(
    picture: Picture[Any], block: dict[str, Any]
) -> None:
    first, again = rendered(picture, block), rendered(picture, block)
    assert first is not None and first == again and first[0] == "svg"
    text = first[1].decode()
    assert text.startswith("<?xml") and "dc:date" not in text and "matplotlib.org" not in text
    figure = picture.draw(block)
    assert figure is not None
    for axes in figure.axes:
        assert _UNITS.search(axes.get_xlabel()) and _UNITS.search(axes.get_ylabel())
    assert picture.sentence(block).endswith(".") and re.search(r"\d", picture.sentence(block))
    assert picture.reason(block) == ""


@pytest.mark.parametrize("picture", GALLERY, ids=list(BY_NAME))
def test_a_picture_takes_no_more_than_it_says_it_needs(picture: Picture[Any], block: dict[str, Any]) -> None:
    optional = {"stated", "ellipsoid", "adjusted_water", "dependence"}
    needed = {name: table for name, table in block.items() if name in {*picture.needs, *optional}}
    for name, fields in picture.needs.items():
        if fields and name not in optional:
            needed[name] = {field: needed[name][field] for field in fields}
    assert picture.sentence(needed) == picture.sentence(block)


def test_many_marks_make_a_png(block: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    figure = BY_NAME["plan"].draw(block)
    number = marks(figure)
    assert number > len(block["points"]["point"]) * 2  # a marker and an ellipse each
    monkeypatch.setattr(gallery, "MOST_MARKS", number - 1)
    found = rendered(BY_NAME["plan"], block)
    assert found is not None and found[0] == "png" and found[1].startswith(b"\x89PNG")
    assert found == rendered(BY_NAME["plan"], block)


def test_digits_of_texts_are_left_alone() -> None:
    """What is shortened in an SVG file stands in its tags: a label keeps its minutes to three decimals."""
    found = rendered(BY_NAME["plan"], st_thomas())
    assert found is not None and re.search(r"18°\d\d\.\d{3}'N, m", found[1].decode())
    assert not re.search(r'[dxy]="[^"]*\d\.\d{3}', found[1].decode())


def test_the_plan_shows_what_the_record_has(block: dict[str, Any]) -> None:
    plan = block_plan(block)
    control = block["control"]
    assert plan.control.tolist() == control["point"] and plan.checks.sum() == 3
    known = np.array(control["difference"], dtype=float)[:, :2]
    np.testing.assert_allclose(plan.discrepancy, known)  # a local job: the plane is its own
    sigma = np.array(block["points"]["sigma"], dtype=float)[:, :2]
    assert (plan.axes[:, 0] >= 2.4477 * sigma.max(axis=1) - 1e-9).all()
    size = np.hypot(*known[plan.checks].T)
    assert f"{size.max():.3g}"[:4] in BY_NAME["plan"].sentence(block)


def test_stations_are_held_against_their_observed_positions(block: dict[str, Any]) -> None:
    found, stations = observed_stations(block), block["stations"]
    expected = np.array(stations["position"]) - np.array(stations["given_position"])
    np.testing.assert_allclose(found.difference, expected, atol=1e-9)
    assert found.names == ("X", "Y", "Z")


def test_differences_of_a_geographic_job_are_east_north_up() -> None:
    tables = st_thomas()
    stations = tables["stations"]
    level = np.array(stations["position"])
    level[:, 0] += 2.0 / 6.37e6  # about 2 m north
    stations["given_position"], stations["given_position_sigma"] = level.tolist(), [[1.0, 1.0, None]] * 3
    found = observed_stations(tables)
    np.testing.assert_allclose(found.difference[:, 0], 0.0, atol=1e-4)
    np.testing.assert_allclose(found.difference[:, 1], -2.0, atol=0.02)  # by the radius of the ellipsoid
    assert np.isnan(found.difference[:, 2]).all()
    assert "north" in BY_NAME["gnss"].sentence(tables)


def test_wet_and_dry_are_averaged_apart(block: dict[str, Any]) -> None:
    means = mean_residuals(block)
    wet = dict(zip(block["points"]["point"], block["points"]["bathymetric"], strict=True))
    number = sum(wet[point] for point in block["plates"]["point"])
    assert [part.what for part in means] == ["dry points", "submerged points"]
    assert [part.count.sum() for part in means] == [len(block["plates"]["point"]) - number, number]


def test_the_profile_has_the_heights_of_the_record(block: dict[str, Any]) -> None:
    found, wet = profile(block), block["bathymetric_points"]
    heights = {round(height, 6): level for height, level in zip(wet["height"], wet["water_level"], strict=True)}
    assert len(found.distance) >= 6 and (np.diff(found.distance) >= 0.0).all()
    for height, depth in zip(found.corrected.tolist(), found.depth.tolist(), strict=True):
        assert heights[round(height, 6)] - depth == pytest.approx(height, abs=1e-6)
    assert (found.apparent - found.corrected > 0.3).all()  # two metres deep at least
    assert found.line.name.startswith("strip") and len(found.water) >= 3


# --- records that lack something, or have too much ---


def without(tables: dict[str, Any], name: str) -> dict[str, Any]:
    del tables[name]
    return tables


def one_photo(tables: dict[str, Any]) -> dict[str, Any]:
    tables["stations"] = {name: column[:1] for name, column in tables["stations"].items()}
    photo = tables["stations"]["photo"][0]
    plates = tables["plates"]
    rows = [row for row, name in enumerate(plates["photo"]) if name == photo]
    tables["plates"] = {name: [column[row] for row in rows] for name, column in plates.items()}
    tables["adjusted_water"] = {**tables["adjusted_water"], "tide": tables["adjusted_water"]["tide"][:1]}
    tables["water_precision"] = {name: [] for name in tables["water_precision"]}
    return tables


def nothing_known(tables: dict[str, Any]) -> dict[str, Any]:
    """Return a run in which no point has a place, a sigma or a residual."""
    for name, fields in {
        "points": ("position", "sigma", "covariance"),
        "plates": ("residual",),
        "observations": ("standardised",),
        "bathymetric_points": ("no_refraction", "depth", "depth_sigma", "depth_no_refraction", "water_level"),
        "control": ("difference",),
        "stations": ("covariance", "position_sigma", "attitude_sigma"),
    }.items():
        for field in fields:
            tables[name][field] = [None] * len(tables[name][field])
    return tables


def no_water(tables: dict[str, Any]) -> dict[str, Any]:
    tables["bathymetric_points"] = {name: [] for name in tables["bathymetric_points"]}
    tables["points"]["bathymetric"] = [False] * len(tables["points"]["point"])
    tables["adjusted_water"] = None
    tables["stations"]["tide"] = [None] * len(tables["stations"]["photo"])
    tables["water_precision"] = {name: [] for name in tables["water_precision"]}
    return tables


def far_off(tables: dict[str, Any]) -> dict[str, Any]:
    """Return a run that went astray: a point and a station farther off than the earth is large."""
    for name in ("points", "stations"):
        tables[name]["position"][0] = [1e15, -1e15, 1e12]
    return tables


LACKING: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "without observations": lambda tables: without(tables, "observations"),
    "without points": lambda tables: {**tables, "points": {name: [] for name in tables["points"]}},
    "without stations": lambda tables: {**tables, "stations": {name: [] for name in tables["stations"]}},
    "of one photo": one_photo,
    "with nothing known": nothing_known,
    "without water": no_water,
    "that went astray": far_off,
}


@pytest.mark.parametrize("change", LACKING.values(), ids=list(LACKING))
def test_a_record_that_lacks_something_has_reasons_and_sentences(
    change: Callable[[dict[str, Any]], dict[str, Any]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    tables = change(gnss_block(tmp_path_factory.getbasetemp()))
    for picture in GALLERY:
        said = picture.sentence(tables)
        assert not re.search(r"\b(nan|inf|None)\b", said), picture.name
        assert said == picture.reason(tables) or said.endswith("."), picture.name


@pytest.mark.slow
@pytest.mark.parametrize("change", LACKING.values(), ids=list(LACKING))
def test_a_record_that_lacks_something_is_drawn(
    change: Callable[[dict[str, Any]], dict[str, Any]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    tables = change(gnss_block(tmp_path_factory.getbasetemp()))
    for picture in GALLERY:
        assert (rendered(picture, tables) is None) == bool(picture.reason(tables)), picture.name


def test_reasons_say_what_is_lacking() -> None:
    tables = st_thomas()
    assert BY_NAME["gnss"].reason(tables) == "no position of a station was observed"
    assert BY_NAME["gnss"].draw(tables) is None and rendered(BY_NAME["gnss"], tables) is None
    assert BY_NAME["normalised"].reason(without(tables, "observations")) == "the record has no table observations"


def test_needs_name_what_the_schema_has() -> None:
    schema = json.loads((Path(gallery.__file__).parents[1] / "reports/record.schema.json").read_text())
    for table, fields in needs_of(GALLERY).items():
        there = schema["properties"][table]
        assert set(fields) <= set(there.get("properties", there.get("items", {}).get("properties", {})))


PLACE = [0.2, 0.25, 0.7, 0.6]


def ours(**given):
    figure = Figure((4.0, 3.0))
    axes = panel.add_panel(figure, PLACE)
    axes.set(**given)
    return figure, axes


@pytest.mark.parametrize("limits", [(-3.0, 11.0), (80123.0, 80999.0), (5.0, -5.0), (0.0, 1e-3)])
def test_ticks_are_those_of_matplotlib(limits):
    _, axes = ours(xlim=limits, ylim=limits)
    other = Figure((4.0, 3.0)).add_axes(PLACE)
    other.set(xlim=limits, ylim=limits)
    for one in (axes, other):
        one.tick_params(labelsize=10.0)
        one.ticklabel_format(useOffset=False, style="plain")
    places, labels = panel._ticks(axes, 0)
    low, high = sorted(limits)
    wanted = [tick for tick in other.get_xticks() if low <= tick <= high]
    np.testing.assert_allclose(places, other.transData.transform([(tick, limits[0]) for tick in wanted])[:, 0])
    assert labels == other.xaxis.get_major_formatter().format_ticks(wanted)


def test_an_arrow_ends_where_its_vector_does():
    starts, ends = np.array([[10.0, 10.0], [0.0, 0.0]]), np.array([[110.0, 10.0], [0.0, 4.0]])
    corners = arrow_corners(starts, ends, 2.0)
    np.testing.assert_allclose(corners[:, 3], ends)
    np.testing.assert_allclose(0.5 * (corners[:, 0] + corners[:, 6]), starts)
    assert np.ptp(corners[0, :, 1]) == pytest.approx(6.0)  # its head is three times as wide as the shaft
    assert corners[0, 2, 0] == pytest.approx(100.0) and corners[0, 1, 0] == pytest.approx(101.0)
    assert np.ptp(corners[1, :, 0]) == pytest.approx(2.4)  # a short one is all head, and smaller
    assert np.isfinite(arrow_corners(starts, starts, 2.0)).all()


def test_arrows_and_names_are_drawn_on_the_axes_only():
    figure, axes = ours(xlim=(0.0, 10.0), ylim=(0.0, 10.0))
    add_arrows(
        axes, np.array([[5.0, 5.0], [5.0, 8.0]]), np.array([[2.0, 0.0], [99.0, 0.0]]), color="black", width=0.01
    )
    assert marks(figure) >= 2
    add_names(axes, np.array([[2.0, 2.0], [20.0, 2.0]]), np.array(["here", "NOT"]))
    text = svg(figure, "a").decode()
    assert ">here<" in text and "NOT" not in text


def test_tables_that_are_shared_are_worked_out_once():
    asked = []

    @worked_out_once
    def size(tables):
        asked.append(1)
        return len(tables)

    shared = SharedTables({"a": 1, "b": 2})
    assert [size(shared), size(shared), size(SharedTables({})), size({"a": 1}), size({"a": 1})] == [2, 2, 0, 1, 1]
    assert len(asked) == 4
