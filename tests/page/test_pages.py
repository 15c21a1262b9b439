"""What stands on the page of a run, against the record and against numbers found another way."""

import datetime
import json
import re

import numpy as np
import pytest
import shapely

from cli.commands import musat
from musatpy.errors import RecordError
from musatpy.page.composition import page_of_record
from musatpy.units import ARC_SECOND, DEGREE
from page.pages import ROOT, ST_THOMAS, Reader, read, record, record_text, written

HOSTILE = "<img src=x onerror=alert(1)>"


@pytest.fixture(autouse=True)
def _without_pictures(monkeypatch):
    """Pictures take most of the time, and have tests of their own."""
    monkeypatch.setattr("musatpy.page.composition.pictures", lambda *_: ())


@pytest.fixture
def page(tmp_path):
    return read(written(tmp_path))


def numbers(rows, head):
    return np.array([float(row[head]) for row in rows if row[head]])


def test_the_verdict_stands_first(page):
    before, _, after = page.text.partition("ACCEPTED")
    assert "Accuracy" not in before and "no test rejects it" in after[:60]


@pytest.mark.slow
def test_the_head_says_the_system_of_the_job_and_what_is_given_for_the_page(tmp_path):
    (tmp_path / "utm").mkdir()
    run = written(tmp_path)
    assert musat("report", run, "-o", tmp_path / "a.html", "--date", "--client", "A & <B>").exit_code == 0
    head = Reader((tmp_path / "a.html").read_text()).text.partition("ACCEPTED")[0]
    for said in ("Datumnot named; ellipsoid Clarke 1866", "Heightsabove the ellipsoid", "ClientA & <B>"):
        assert said in head
    assert f"Date{datetime.date.today():%Y-%m-%d}" in head and "Operator" not in head
    utm = written(tmp_path / "utm", record_text(ROOT / "fixtures" / "st_thomas_utm" / "st_thomas_utm.crd"))
    head = read(utm).text.partition("ACCEPTED")[0]
    assert "Coordinate systemPuerto Rico / St. Croix, EPSG:3992, ellipsoidal heights\n" in head.replace(" \n", "\n")
    assert "DatumPuerto Rico" in head
    local = written(tmp_path, record_text(ROOT / "fixtures" / "verdict" / "iiia_false_minimum.crd"))
    assert "Datumnone: a local system" in read(local).text and "HeightsZ of the job" in read(local).text
    result = musat("run", ST_THOMAS, "-o", tmp_path / "none", "--client", "A")
    assert result.exit_code == 2 and "--client and --operator go with --html" in result.output


def test_the_figures_are_those_of_page_1(page):
    assert page.fact("Sigma0").startswith("0.9361by chance 0.735 to 1.265 (95 %), at most 1.433")
    assert page.fact("RMS of plate residuals, x and y").startswith("1.36 and 3.15 µm")
    assert page.fact("Common errors without test").startswith("focal length of RC80.1522 mm moves station 22")
    assert page.fact("Common errors weakly tested").startswith("principal point x, RC8")


def test_control_and_check_points_against_the_cards_and_the_record(page):
    control = record()["control"]
    difference, used = (np.array(control[name], dtype=float) for name in ("difference", "used"))
    check = np.array([kind == "check" for kind in control["kind"]])
    rows = page.rows("Control And Check Points: Adjusted Minus Given")
    for axis, name in enumerate(("East", "North", "Up")):
        for what, chosen in (("Control", ~check & (used[:, axis] > 0)), ("Check points", check)):
            values = difference[chosen, axis]
            (row,) = (row for row in rows if (row["Points"], row["Component"]) == (what, name))
            assert int(row["Number"]) == len(values)
            assert float(row["RMS m"]) == pytest.approx(np.sqrt(np.mean(values**2)), abs=5.1e-4)
            assert float(row["Mean m"]) == pytest.approx(values.mean(), abs=5.1e-4)
            assert abs(float(row["Maximum m"])) == pytest.approx(np.abs(values).max(), abs=5.1e-4)


def test_rows_are_those_of_the_record_the_worst_first(page):
    rows = page.rows("Statistics: Observations, The Worst First")
    tests = np.abs(numbers(rows, "Test value"))
    given = np.array(record()["observations"]["test"], dtype=float)
    known = np.sort(np.abs(given[~np.isnan(given)]))[::-1]
    np.testing.assert_allclose(tests, known[: len(tests)], atol=5.1e-3)  # two decimals
    assert {row["Unit"] for row in rows} <= {"µm", "m", "″"}
    assert float(rows[0]["Sigma"]) == 5.0  # um, of the option card
    assert "20 of 112 rows" in page.text


def test_angles_read_back_to_their_printed_digit(page):
    rows = page.rows("Adjusted Exposure Stations: Positions")
    given = dict(zip(record()["stations"]["photo"], record()["stations"]["position"], strict=True))
    assert len(rows) == 3
    for row in rows:
        for axis, head in enumerate(("Latitude ° ′ ″", "Longitude ° ′ ″")):
            d, m, s = (float(part) for part in re.findall(r"-?[\d.]+", row[head]))
            angle = (abs(d) + m / 60.0 + s / 3600.0) * DEGREE * (-1.0 if row[head].startswith("-") else 1.0)
            assert angle == pytest.approx(given[row["Photo"]][axis], abs=0.51e-5 * ARC_SECOND)
        assert float(row["Elevation m"]) == pytest.approx(given[row["Photo"]][2], abs=5.1e-4)


def test_what_refraction_changed(page):
    points = record()["bathymetric_points"]
    depth, straight = (np.array(points[name], dtype=float) for name in ("depth", "depth_no_refraction"))
    found = re.search(r"deeper by ([\d.]+) m in the mean, by ([\d.]+) m at most \(point (\w+)\)", page.text)
    assert float(found[1]) == pytest.approx((depth - straight).mean(), abs=5.1e-3)
    assert float(found[2]) == pytest.approx((depth - straight).max(), abs=5.1e-3)
    assert found[3] == points["point"][int((depth - straight).argmax())]
    # in plan: positions less their components along the vertical, from geocentric coordinates
    moved = np.subtract(points["refraction"], points["no_refraction"])
    up = np.array(points["no_refraction"]) / np.linalg.norm(points["no_refraction"], axis=1)[:, None]
    plan = np.linalg.norm(moved - np.sum(moved * up, axis=1)[:, None] * up, axis=1)
    mean = float(re.search(r"moved them in plan by ([\d.]+) m", page.text)[1])
    assert mean == pytest.approx(plan.mean(), abs=0.02)  # the geocentric vertical is .2 degrees off the normal


def test_orders_of_s44_against_the_standard(page):
    """IHO S-44, edition 6.1.0, table 1: sqrt(a^2 + (b d)^2) at 95 %, here 1.96 sigma of the height."""
    points = record()["points"]
    wet = dict(zip(points["point"], points["covariance"], strict=True))
    bathymetric = record()["bathymetric_points"]
    met = 0
    for name, depth in zip(bathymetric["point"], bathymetric["depth"], strict=True):
        covariance = np.array(wet[name])
        up, plan = 1.96 * np.sqrt(covariance[2, 2]), 2.448 * np.sqrt(np.linalg.eigvalsh(covariance[:2, :2])[-1])
        met += up <= np.hypot(0.5, 0.013 * max(depth, 0.0)) and plan <= 5.0 + 0.05 * max(depth, 0.0)
    row = next(row for row in page.rows("Orders Of S-44 Met By The Depths") if row["Order"] == "1a/1b")
    assert int(row["Points that meet it"]) == met
    assert float(row["Share %"]) == pytest.approx(100.0 * met / len(bathymetric["point"]), abs=0.051)


def test_the_order_of_a_run_is_that_of_nearly_all_its_depths(tmp_path):
    """Of eight points all: one that meets no order, or a lower one, takes the run's with it."""
    label = "Order of S-44 that 95 % of the depths meet"
    (best,) = {row["Order"] for row in read(written(tmp_path)).rows("Orders Of S-44 Met By The Depths")} & {"1a/1b"}
    found = []
    for factor in (1e-4, 1e6):
        rows = json.loads(record_text())
        wet = rows["bathymetric_points"]["point"]
        for number, name in enumerate(wet):
            row = rows["points"]["point"].index(name)
            covariance = np.diag([1e-4, 1e-4, 1e-4 * (factor if number == 3 else 1e-4)])
            rows["points"]["covariance"][row] = covariance.tolist()
        found.append(read(written(tmp_path, json.dumps(rows))).fact(label))
    assert len(wet) == 8 and found[0].split()[0] != found[1].split()[0] and best


def test_the_flight(page):
    assert "2378 m" in page.text and "1 : 15,600" in page.text  # 2378 m / 152.25 mm
    assert [row["Rays"] for row in page.rows("Rays To Ground Points")] == ["2", "3"]


def test_every_link_leads_somewhere_and_ids_are_single(page):
    assert len(page.links) > 15
    assert {link.removeprefix("#") for link in page.links} <= set(page.ids)
    assert len(page.ids) == len(set(page.ids))


def test_nothing_is_asked_of_a_network(tmp_path):
    html = page_of_record(written(tmp_path))
    reader = Reader(html)
    names = {tag for tag, _ in reader.tags}
    assert not names & {"script", "iframe", "object", "embed", "form", "base"}
    policies = [given["content"] for tag, given in reader.tags if tag == "meta" and "http-equiv" in given]
    assert policies == ["default-src 'none'; img-src data:; style-src 'unsafe-inline'"]
    outside = [given.get(name) for _, given in reader.tags for name in ("src", "href", "srcset") if given.get(name)]
    assert all(place.startswith(("#", "data:")) for place in outside)
    assert not [name for _, given in reader.tags for name in given if name.startswith("on")]


def test_tables_have_heads_with_scope_and_are_reached_by_keyboard(page):
    heads = [given for tag, given in page.tags if tag == "th"]
    assert heads and all(given.get("scope") in ("row", "col") for given in heads)
    regions = [given for tag, given in page.tags if tag == "div" and given.get("role") == "region"]
    tables = [given for tag, given in page.tags if tag == "table"]
    assert len(regions) == len(tables) > 10
    assert all(given.get("tabindex") == "0" and given["aria-labelledby"] in page.ids for given in regions)


def renamed(value, names):
    """Return a record in which ids are other ones, wherever they stand."""
    if isinstance(value, dict):
        return {key: renamed(entry, names) for key, entry in value.items()}
    if isinstance(value, list):
        return [renamed(entry, names) for entry in value]
    return names.get(value, value) if isinstance(value, str) else value


def test_names_are_escaped(tmp_path):
    rows = json.loads(record_text())
    rows["titles"] = [HOSTILE, "\x1b[31m \u202e"]
    names = {"21": HOSTILE, "23": '"><b>', rows["points"]["point"][0]: HOSTILE}
    rows = renamed(rows, names)
    rows["solution"]["warnings"] = [HOSTILE]
    html = page_of_record(written(tmp_path, json.dumps(rows)))
    reader = Reader(html)
    assert not [tag for tag, _ in reader.tags if tag in ("img", "b")]
    assert reader.text.count(HOSTILE) > 4
    assert "\x1b" not in html and "\u202e" not in html


def test_a_table_that_is_missing_is_asked_for(tmp_path):
    kept = record()
    del kept["control"], kept["stations"]["attitude"]
    with pytest.raises(RecordError, match=r"(?s)stations.attitude: is missing.*control: is missing"):
        page_of_record(written(tmp_path, json.dumps(kept)))


def test_a_record_without_images_has_a_page(tmp_path):
    kept = json.loads(record_text())
    del kept["plates"]
    kept["content"] = "tables"
    assert "Adjusted Exposure Stations" in read(written(tmp_path, json.dumps(kept))).text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[1, 2]", "is not the record of a run, of a compilation or of a comparison"),
        ('{"compilation_version": "2.0"}', "job: is missing"),
    ],
)
def test_what_is_no_record_is_refused(tmp_path, text, message):
    with pytest.raises(RecordError, match=re.escape(message)):
        page_of_record(written(tmp_path, text))


def test_an_unconverged_run_says_so_with_the_place_of_its_reason(tmp_path):
    page = read(written(tmp_path, record_text(ST_THOMAS, "FULL      20  20", "FULL       1   1")))
    assert "FAILED" in page.text and "not converged, not to be used" in page.text
    assert "limits not reached in 1 iteration" in page.text


@pytest.mark.parametrize("wet", [False, True])
def test_a_run_without_water_or_dry_points(tmp_path, wet):
    run = record()
    run["points"]["bathymetric"] = [wet] * len(run["points"]["point"])
    if not wet:
        run["bathymetric_points"] = {name: [] for name in run["bathymetric_points"]}
        run["adjusted_water"] = run["water"] = None
        run["plates"]["refraction"] = [[0.0, 0.0]] * len(run["plates"]["photo"])
    page = read(written(tmp_path, json.dumps(run)))
    assert f"({22 * wet} submerged)" in page.text and ("What Refraction Changed" in page.text) is wet


def test_positions_in_the_output_system(tmp_path):
    text = record_text(ROOT / "fixtures" / "st_thomas_utm" / "st_thomas_utm.crd")
    stated = json.loads(text)["stated"]
    page, of_system = read(written(tmp_path, text)), "In The Output System"
    row = {name: number for number, name in enumerate(stated["stations"]["photo"])}
    rows = page.rows(f"Adjusted Exposure Stations: The Map There: {of_system}")
    scales = [[float(row["Scale along meridian"]), float(row["Scale along parallel"])] for row in rows]
    order = [row[shown["Photo"]] for shown in rows]
    np.testing.assert_allclose(scales, np.array(stated["stations"]["scale"])[order], atol=5.1e-8)
    rows = page.rows(f"Adjusted Exposure Stations: Positions: {of_system}")
    heads = list(rows[0])
    assert heads[:4] == ["Photo", "Camera", "E US survey foot", "N US survey foot"]
    shown = np.array([[float(row[head]) for head in heads[2:]] for row in rows])
    np.testing.assert_allclose(shown[:, :3], np.array(stated["stations"]["position"])[order], atol=5.1e-4)
    variance = np.diagonal(np.array(stated["stations"]["covariance"]), axis1=1, axis2=2)[order, :3]
    np.testing.assert_allclose(shown[:, 3:], np.sqrt(variance), atol=5.1e-4)
    assert {f"Adjusted Exposure Stations: Attitudes: {of_system}", f"Adjusted Ground Points: {of_system}"} <= set(
        page.tables
    )


def test_columns_of_a_local_job(tmp_path):
    local = ROOT / "fixtures" / "verdict" / "iiia_false_minimum.crd"
    page = read(written(tmp_path, record_text(local)))
    places = np.array(json.loads(record_text(local))["points"]["position"], dtype=float)
    assert f"Area{shapely.MultiPoint(places[:, :2]).convex_hull.area / 1e6:.2f} km²" in page.text
    assert page.tables["Adjusted Exposure Stations: Positions"][0][2:5] == ["X m", "Y m", "Z m"]
    assert "Sigma X m" in page.tables["Adjusted Ground Points"][0]


@pytest.mark.slow
def test_what_edit_left_out_stands_with_its_tests(tmp_path):
    text = record_text(ROOT / "fixtures" / "verdict" / "edit_point_206_420m.crd")
    found, rows = json.loads(text)["findings"], read(written(tmp_path, text)).rows("Blunders Found")
    assert [row["Test"] for row in rows] == sorted((row["Test"] for row in rows), key=lambda t: -abs(float(t)))
    assert len(rows) == len(found) > 0
