"""Every picture of a run: what it shows and says, records that lack something, and signs drawn in one stroke."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.quiver import Quiver, QuiverKey
from matplotlib.text import Text

from musatpy.figures import WET
from musatpy.plots import gallery
from musatpy.plots.block_plan import block_plan
from musatpy.plots.depth_profile import ProfileLine, profile
from musatpy.plots.exposures import observed_stations
from musatpy.plots.gallery import COMPILED, GALLERY, SOUNDED, marks, needs_of, rendered
from musatpy.plots.picture import Picture
from musatpy.plots.plate_residuals import mean_residuals, plate_residuals
from page.pages import compiled_text, sounded_text
from plots.plot_records import gnss_block, st_thomas

LINE = np.array([[3000.0, 7000.0], [7000.0, 7000.0]])
BY_NAME = {picture.name: picture for picture in GALLERY}
FIGURES = [*BY_NAME, *(f"compiled {one.name}" for one in COMPILED), *(f"compared {one.name}" for one in SOUNDED)]
_UNITS = re.compile(
    r", m$|, [mu]m$|sigma$|residuals$|depth, m|by, m|photo$|correlation$|factor$|distribution$|cell$|^$"
)


@pytest.fixture(scope="module")
def block() -> dict[str, Any]:
    return gnss_block()


@pytest.fixture(scope="module")
def figures(block: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of all pictures of the block, drawn, by name; and of a compilation and of soundings."""
    found = {picture.name: laid_out(picture, block) for picture in GALLERY}
    compiled, sounded = json.loads(compiled_text()), json.loads(sounded_text())
    found |= {f"compiled {picture.name}": laid_out(picture, compiled) for picture in COMPILED}
    return found | {f"compared {picture.name}": laid_out(picture, sounded) for picture in SOUNDED}


def laid_out(picture: Picture[Any], tables: dict[str, Any]) -> Any:
    found = picture.drawn(tables)
    assert found is not None
    figure, _ = found
    figure.draw_without_rendering()
    return figure


@pytest.mark.slow
@pytest.mark.parametrize("picture", GALLERY, ids=list(BY_NAME))
def test_a_picture_has_the_same_bytes_again(picture: Picture[Any], block: dict[str, Any]) -> None:
    first = rendered(picture, block)
    assert first is not None and first == rendered(picture, block)
    assert first[0] == "svg" or picture.name == "mean_residuals"
    text = first[1].decode()
    assert text.startswith("<?xml") and "dc:date" not in text
    assert first[2] == picture.sentence(block) and first[2].endswith(".") and re.search(r"\d", first[2])


@pytest.mark.slow
@pytest.mark.parametrize("name", BY_NAME)
def test_a_picture_names_its_job_and_has_units(name: str, figures: dict[str, Any]) -> None:
    figure = figures[name]
    assert "SIMULATED BLOCK" in figure.get_suptitle()
    for axes in [one for panel in figure.axes for one in (panel, *panel.child_axes)]:
        assert _UNITS.search(axes.get_xlabel()) and _UNITS.search(axes.get_ylabel())


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_no_zero_has_a_sign(name: str, figures: dict[str, Any], block: dict[str, Any]) -> None:
    written = [text.get_text() for text in figures[name].findobj(Text)]
    assert len(written) > 10
    if name in BY_NAME:
        written.append(BY_NAME[name].sentence(block))
    assert not [text for text in written if re.search("(?<![\\d.])[-\N{MINUS SIGN}]0([.]0+)?(?![\\d.])", text)]


def luminance(colour: Any) -> float:
    channels = np.asarray(to_rgb(colour))
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_every_mark_can_be_seen_on_white(name: str, figures: dict[str, Any]) -> None:
    for axes in figures[name].axes:
        colours = [line.get_color() for line in axes.lines] + [text.get_color() for text in axes.texts]
        colours += [patch.get_edgecolor() for patch in axes.patches]
        for one in axes.collections:
            edges, faces = one.get_edgecolor(), one.get_facecolor()
            colours += list(edges if len(edges) else faces)  # an area, or a pale dot, has an outline
            colours += list(faces) if isinstance(one, Quiver) else []
        for colour in colours:
            if np.array_equal(colour, "white"):  # numbers on dark cells, looked at below
                continue
            assert 1.05 / (luminance(colour) + 0.05) >= 3.0, colour
    shown = [image for axes in figures[name].axes for image in axes.images]
    assert bool(shown) == any(text.get_color() == "white" for axes in figures[name].axes for text in axes.texts)
    for image in shown:
        assert all(1.05 / (luminance(colour) + 0.05) >= 3.0 for colour in image.get_cmap().colors)


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
def test_nothing_is_cut_off_and_legends_are_inside_axes(name: str, figures: dict[str, Any]) -> None:
    for figure in [figures[name], *([drawn_with_long_names(name)] if name in BY_NAME else [])]:
        figure.draw_without_rendering()
        low, high = figure.get_tightbbox().get_points()  # inches
        assert (low >= 0.0).all() and (high <= figure.get_size_inches()).all()
        assert not figure.legends
        for legend, axes in ((axes.get_legend(), axes) for axes in figure.axes if axes.get_legend()):
            inner, outer = legend.get_window_extent(), axes.get_window_extent()
            assert (inner.min >= outer.min).all() and (inner.max <= outer.max).all()


def drawn_with_long_names(name: str) -> Any:
    """Return the figure of the block with names of 8 wide letters and a title of 80."""
    renamed = json.loads(re.sub(r'"(\d+)"', lambda found: f'"W{found[1]:W>7}"', json.dumps(gnss_block())))
    return laid_out(BY_NAME[name], {**renamed, "titles": ["WATER " * 13]})


def test_nine_in_ten_residuals_are_drawn_within_a_fifth_of_the_spacing(block: dict[str, Any]) -> None:
    plates = plate_residuals(block)
    figure = laid_out(BY_NAME["residuals"], block)
    arrows = [one for axes in figure.axes for one in axes.collections if isinstance(one, Quiver)]
    drawn = np.concatenate([np.hypot(one.U, one.V) / one.scale for one in arrows])
    assert len(drawn) == len(plates.residual)
    apart = np.sqrt(228.6**2 / (len(drawn) // len(plates.photos)))
    assert np.percentile(drawn, 90.0) == pytest.approx(0.2 * apart, rel=1e-6)
    keys = [key for axes in figure.axes for key in axes.artists if isinstance(key, QuiverKey)]
    assert {key.label for key in keys} == {f"{keys[0].U:g} um"} and len(keys) == len(plates.photos)


@pytest.mark.parametrize("picture", GALLERY, ids=list(BY_NAME))
def test_a_picture_takes_no_more_than_it_says_it_needs(picture: Picture[Any], block: dict[str, Any]) -> None:
    optional = {"stated", "ellipsoid", "adjusted_water", "dependence"}
    needed = {name: table for name, table in block.items() if name in {*picture.needs, *optional}}
    assert picture.sentence(needed) == picture.sentence(block)


def test_many_marks_make_a_png(block: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    figure = laid_out(BY_NAME["plan"], block)
    number = marks(figure)
    assert number > len(block["points"]["point"]) * 2  # a marker and an ellipse each
    monkeypatch.setattr(gallery, "MOST_MARKS", number - 1)
    found = rendered(BY_NAME["plan"], block)
    assert found is not None and found[0] == "png" and found[1].startswith(b"\x89PNG")
    assert found == rendered(BY_NAME["plan"], block)


def test_labels_keep_their_minutes() -> None:
    found = rendered(BY_NAME["plan"], st_thomas())
    assert found is not None and re.search(r"18°\d\d\.\d{3}'N, m", found[1].decode())


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
    written = {text.get_text() for text in laid_out(BY_NAME["plan"], block).axes[0].texts}
    assert {*control["point"], *block["stations"]["photo"]} <= written


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


def test_a_profile_joins_the_points_beside_its_line_and_marks_the_others(block: dict[str, Any]) -> None:
    found = profile(block, lambda plane: ProfileLine(name="across", vertices=LINE), within=800.0)
    places = np.array(block["points"]["position"])[block["points"]["bathymetric"]]
    offset = np.abs(places[:, 1] - 7000.0)
    inside = (offset <= 800.0) & (np.abs(places[:, 0] - 5000.0) <= 2000.0)
    assert found.near.sum() == (offset[inside] <= 400.0).sum() and 1 < found.near.sum() < len(found.near)
    lines = BY_NAME["profile"].figure(found).axes[0].lines
    assert [len(line.get_xdata()) for line in lines if line.get_label() == "corrected"] == [len(found.distance)]
    joined = [line for line in lines if line.get_marker() == "None" and line.get_color() == WET]
    np.testing.assert_array_equal(joined[0].get_ydata(), found.corrected[found.near])


def test_water_that_was_not_adjusted_is_given() -> None:
    axes, *_ = laid_out(BY_NAME["tides"], st_thomas()).axes
    assert axes.get_legend_handles_labels()[1] == ["given"]


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
    change: Callable[[dict[str, Any]], dict[str, Any]],
) -> None:
    tables = change(gnss_block())
    for picture in GALLERY:
        said = picture.sentence(tables)
        assert not re.search(r"\b(nan|inf|None)\b", said), picture.name
        assert said.endswith(".") or not re.search("\\d", said), picture.name


@pytest.mark.slow
@pytest.mark.parametrize("change", LACKING.values(), ids=list(LACKING))
def test_a_record_that_lacks_something_is_drawn(
    change: Callable[[dict[str, Any]], dict[str, Any]],
) -> None:
    tables = change(gnss_block())
    for picture in GALLERY:
        found = rendered(picture, tables)
        assert picture.sentence(tables).endswith(".") == (found is not None), picture.name


def test_a_table_that_a_record_lacks_is_the_reason() -> None:
    tables = without(st_thomas(), "observations")
    assert BY_NAME["normalised"].sentence(tables) == "the record has no table observations"


def test_needs_name_what_the_schema_has() -> None:
    schema = json.loads((Path(gallery.__file__).parents[1] / "reports/record.schema.json").read_text())
    assert set(needs_of(GALLERY)) <= schema["properties"].keys()
