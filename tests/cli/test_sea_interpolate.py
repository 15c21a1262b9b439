"""`musat correct --by-control`: what it writes, says, and refuses; its old name has the same numbers."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from cli import commands
from depth import restated
from musatpy.model import CoordinateSystem
from musatpy.reports.record import dumps
from musatpy.reports.record import record as record_of_run
from record_rows import with_columns, with_rows
from sample_solutions import sample_solution


def musat(points: object, control: object, *options: object) -> Result:
    """Correct points by their control; `--sigma`, where it is among the options, is that of control."""
    given = ["--control-sigma" if option == "--sigma" else option for option in options]
    return commands.musat("correct", points, "--by-control", control, *given)


ROOT = Path(__file__).parents[2]
FAST = ("--function", "gaussian")


def error_at(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 0.4 * np.sin(x / 60.0) * np.cos(y / 80.0) + 0.1


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """A folder with 60 control points in three ways, and the mapped points of them and 40 others; true at -8 m."""
    rng = np.random.default_rng(2)
    place = rng.uniform(0.0, 400.0, (100, 2))
    error = error_at(*place.T)
    ids = [f"P{row}" for row in range(100)]
    rows = list(zip(ids, *place.T.round(3).tolist(), (error - 8.0).round(4).tolist(), strict=True))
    write(tmp_path / "mapped.csv", "id,x,y,z", rows)
    write(tmp_path / "both.csv", "ID,X,Y,Z_mapped,Z_true", [(*row, -8.0) for row in rows[:60]])
    write(tmp_path / "dz.csv", "dz,id,y,x", [(round(row[3] + 8.0, 4), row[0], row[2], row[1]) for row in rows[:60]])
    write(tmp_path / "true.csv", "id,z_true,sigma", [(row[0], -8.0, 0.01) for row in rows[:60]])
    return tmp_path


def write(path: Path, header: str, rows: list[tuple[object, ...]]) -> None:
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.slow
@pytest.mark.parametrize("control", ["both.csv", "dz.csv", "true.csv"])
def test_heights_are_corrected_by_control_of_every_form(job: Path, control: str) -> None:
    result = musat(job / "mapped.csv", job / control, "-o", job / "new" / "out.csv", *FAST)
    assert result.exit_code == 0, result.output
    assert "100 points, 100 corrected" in result.output and "the interpolation helps (" in result.output
    rows = table(job / "new" / "out.csv")
    assert [row["id"] for row in rows] == [f"P{row}" for row in range(100)]
    left = np.array([float(row["true_z"]) + 8.0 for row in rows[60:]])
    before = np.array([float(row["z"]) + 8.0 for row in rows[60:]])
    assert np.sqrt(np.mean(left**2)) < 0.1 * np.sqrt(np.mean(before**2))
    for row in rows:
        # four decimals each
        assert float(row["true_z"]) == pytest.approx(float(row["z"]) + float(row["correction"]), abs=2e-4)
        assert row["reason"] == "" and float(row["sigma_height"]) > 0.0
    report = (job / "new" / "out.txt").read_text()
    assert f"control {control}" in report and "60 control points, 60 used" in report


@pytest.mark.slow
def test_all_functions_are_compared_where_none_is_chosen(job: Path) -> None:
    assert musat(job / "mapped.csv", job / "dz.csv", "-o", job / "out.csv", "--plots").exit_code == 0
    assert (job / "out.png").read_bytes().startswith(b"\x89PNG")
    report = (job / "out.txt").read_text()
    for name in ("none", "gaussian", "exponential", "elliptic", "bessel", "swell"):
        assert f"\n{name} " in report


def test_what_is_out_of_reach_says_so(job: Path) -> None:
    with (job / "mapped.csv").open("a") as file:
        file.write("FAR,5000,0,-8\n")
    result = musat(job / "mapped.csv", job / "dz.csv", "-o", job / "out.csv", *FAST, "--reach", "30")
    assert result.exit_code == 0
    rows = {row["id"]: row for row in table(job / "out.csv")}
    assert rows["FAR"]["reason"] == "no control within 30.0 m"
    assert [rows["FAR"][name] for name in ("true_z", "correction", "sigma_height")] == ["", "", ""]
    control = np.array([[float(row["x"]), float(row["y"])] for row in table(job / "dz.csv")])
    for row in rows.values():
        distance = np.hypot(*(control - [float(row["x"]), float(row["y"])]).T).min()
        assert (row["reason"] == "") == (distance <= 30.0)


def test_lines_come_out_as_they_were(job: Path) -> None:
    (job / "odd.csv").write_bytes(b'\xef\xbb\xbfnote,EAST,north,z\n"a, b",10.0,20.0,-8\n\n\xff,30,40,-8.10\n')
    result = musat(job / "odd.csv", job / "dz.csv", "-o", job / "out.csv", "--columns", "East,North,z", *FAST)
    assert result.exit_code == 0, result.output
    lines = (job / "out.csv").read_bytes().splitlines()
    assert lines[0] == b"note,EAST,north,z,true_x,true_y,true_z,correction,reason,sigma_height"
    assert lines[1].startswith(b'"a, b",10.0,20.0,-8,10.0000,20.0000,-')
    assert lines[2].startswith(b"\xff,30,40,-8.10,30.0000,40.0000,-")
    assert len(lines) == 3


def test_it_says_where_it_does_not_help(job: Path) -> None:
    rng = np.random.default_rng(1)
    rows = [(f"C{row}", *rng.uniform(0.0, 400.0, 2), rng.normal(0.0, 0.3)) for row in range(40)]
    write(job / "noise.csv", "id,x,y,dz", rows)
    result = musat(job / "mapped.csv", job / "noise.csv", "-o", job / "out.csv", *FAST, "--function", "none")
    assert result.exit_code == 4
    assert "does not help: leave the heights as they are" in result.output
    assert (job / "out.csv").exists() and "does not help" in (job / "out.txt").read_text()
    given = (job / "mapped.csv", job / "noise.csv", "-o", job / "old.csv", *FAST, "--function", "none")
    assert commands.musat("sea", "interpolate", *given).exit_code == 3  # of the old name
    assert (job / "old.csv").read_bytes() == (job / "out.csv").read_bytes()


def test_sigmas_are_honest_where_nothing_is_explained(job: Path) -> None:
    """With the trend alone all of the errors stays, and the sigmas say so."""
    musat(job / "mapped.csv", job / "dz.csv", "-o", job / "out.csv", "--function", "none")
    rows = table(job / "out.csv")[60:]
    ratio = [(float(row["true_z"]) + 8.0) / float(row["sigma_height"]) for row in rows]
    # forty points of a field with some ten patches: a fifth of standard error
    assert np.sqrt(np.mean(np.square(ratio))) == pytest.approx(1.0, abs=0.4)


@pytest.mark.slow
def test_an_outlier_is_named(job: Path) -> None:
    text = (job / "true.csv").read_text().replace("P9,-8.0,", "P9,-5.0,")
    (job / "true.csv").write_text(text)
    musat(job / "mapped.csv", job / "true.csv", "-o", job / "out.csv", *FAST)
    report = (job / "out.txt").read_text()
    assert "60 control points, 59 used" in report
    said = next(line for line in report.splitlines() if line.startswith("    P9: "))
    assert float(said.split()[1]) == pytest.approx(-3.0, abs=0.3)  # what is seen of it is not all of it
    musat(job / "mapped.csv", job / "true.csv", "-o", job / "out.csv", *FAST, "--keep-outliers")
    assert "60 control points, 60 used" in (job / "out.txt").read_text()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("id,x,y,dz\n", "no control point"),
        ("id,x,y\n", "no columns x, y, dz or z_true among id, x, y"),
        ("id,lon,lat,dz\n", "no columns x, y, dz or z_true among id, lon, lat, dz"),  # no metres of a local job
        ("id,x,y,dz\nA,1,2,nan\n", "bad.csv:2 cols 7-9 dz: 'nan' is not a number"),
        ("id,x,y,dz\nA,1,2,3\nB,1,2,3\nC,1,2,4\nD,1,2,4\n", "all control points stand at one place"),
        ("id,x,y,dz\nA,1,2,3\nB,4,5,6\nC,7,9,8\n", "3 control points are too few: a constant as trend needs 4"),
        ("id,x,y,dz,z_mapped,z_true\n", "columns dz and z_mapped: one is meant"),
        ("id,z_true\nP1,-8\nQ1,-8\nQ2,-8\n", "no point 'Q1' in"),
    ],
)
def test_control_that_cannot_be_used(job: Path, text: str, message: str) -> None:
    (job / "bad.csv").write_text(text)
    result = musat(job / "mapped.csv", job / "bad.csv", "-o", job / "out.csv")
    assert result.exit_code == 1 and message in result.output
    assert not (job / "out.csv").exists()


def test_columns_that_are_not_there_or_there_already(job: Path) -> None:
    (job / "nameless.csv").write_text("x,y,z\n1,2,3\n")
    result = musat(job / "nameless.csv", job / "true.csv", "-o", job / "out.csv", *FAST)
    assert result.exit_code == 1 and "no column id among x, y, z" in result.output
    (job / "twice.csv").write_text((job / "mapped.csv").read_text() + "P3,0,0,0\n")
    result = musat(job / "twice.csv", job / "true.csv", "-o", job / "out.csv", *FAST)
    assert result.exit_code == 1 and ":102 cols 1-2 id: control point 'P3' is there a second time" in result.output


@pytest.mark.slow
def test_a_sigma_that_no_control_point_needs_is_refused(job: Path) -> None:
    result = musat(job / "mapped.csv", job / "true.csv", "-o", job / "out.csv", "--sigma", 0.02, *FAST)
    assert result.exit_code == 1
    assert "all control points have sigmas of their own, so none can be given" in result.output
    assert not list(job.glob("*out*"))
    # one point without is enough
    text = (job / "true.csv").read_text()
    (job / "true.csv").write_text(text.replace(",0.01\n", ",\n", 1))
    assert musat(job / "mapped.csv", job / "true.csv", "-o", job / "out.csv", "--sigma", 0.02, *FAST).exit_code == 0


def test_inputs_are_not_overwritten(job: Path) -> None:
    for out in ("mapped.csv", "dz.csv", "x.txt"):
        result = musat(job / "mapped.csv", job / "dz.csv", "-o", job / out, *FAST)
        assert result.exit_code == 2, out
    assert musat(job / "mapped.csv", job / "dz.csv", "-o", job / "o.csv", "--columns", "x,y").exit_code == 2
    assert musat(job / "none.csv", job / "dz.csv", "-o", job / "o.csv", *FAST).exit_code == 1


def record(job: Path, system: str = "LOCL") -> Path:
    """Write what a run leaves of the mapped points: the first sixty are check points, two are no use."""
    rows = [[float(row[name]) for name in "xyz"] for row in table(job / "mapped.csv")]
    points = [
        {"point": f"P{no}", "bathymetric": no != 70, "position": place, "reason": None}
        for no, place in enumerate(rows)
    ]
    points.append({"point": "LOST", "bathymetric": True, "position": [None] * 3, "reason": "one ray, not two"})
    control = [
        {
            "point": f"P{no}",
            "kind": "check" if no < 60 else "full",
            "given_position": [*rows[no][:2], -8.0 if no < 60 else 99.0],
            "given_sigma": [None, None, 0.02 if no % 2 else None],
        }
        for no in range(65)
    ]
    path = job / f"run_{system}.json"
    run = with_rows(json.loads(dumps(record_of_run(sample_solution(CoordinateSystem.LOCAL)))))
    run["points"] = [run["points"][0] | row for row in points]
    run["control"] = [run["control"][0] | row for row in control]
    run["options"]["system"], run["stated"] = system, None
    path.write_text(json.dumps(with_columns(run)))
    return path


def test_the_record_of_a_run_holds_points_and_control(job: Path) -> None:
    run = record(job)
    result = musat(run, run, "-o", job / "out.csv", *FAST)
    assert result.exit_code == 0, result.output
    assert "60 control points, 60 used" in (job / "out.txt").read_text()
    rows = {row["id"]: row for row in table(job / "out.csv")}
    assert rows["P70"]["reason"] == "not under water" and rows["P70"]["x"]
    assert rows["LOST"]["reason"] == "not determined: one ray, not two" and rows["LOST"]["x"] == ""
    assert "101 points, 99 corrected" in result.output
    assert float(rows["P80"]["true_z"]) == pytest.approx(-8.0, abs=0.05)


def test_records_that_cannot_be_used(job: Path) -> None:
    geographic = record(job, "GEOG")
    assert "a GEOG job needs an ellipsoid" in musat(geographic, geographic, "-o", job / "out.csv").output
    run = record(job)
    bare = json.loads(run.read_text())
    bare["control"] = {name: [] for name in bare["control"]}
    run.write_text(json.dumps(bare))
    assert "no check point under water has a height" in musat(run, run, "-o", job / "out.csv").output


@pytest.mark.slow
def test_a_record_on_the_ellipsoid_is_corrected_as_a_local_one(job: Path) -> None:
    """A geographic job and its check points: heights as of the local job, places in degrees."""
    local = record(job)
    assert musat(local, local, "-o", job / "local.csv", *FAST).exit_code == 0
    run = json.loads(local.read_text())
    run["options"]["system"] = "GEOG"
    run["ellipsoid"] = {"name": "WGS84", "semi_major_axis": None, "inverse_flattening": None}
    for name, key in (("points", "position"), ("control", "given_position")):
        places = run[name][key]
        run[name][key] = [one if one[0] is None else restated.geographic(np.array(one)).tolist() for one in places]
    path = job / "geographic.json"
    path.write_text(json.dumps(run))
    result = musat(path, path, "-o", job / "out.csv", *FAST)
    assert result.exit_code == 0, result.output
    rows, wanted = table(job / "out.csv"), table(job / "local.csv")
    assert [row["reason"] for row in rows] == [row["reason"] for row in wanted]
    good = [k for k, row in enumerate(rows) if not row["reason"]]
    found = np.array([[float(rows[k][name]) for name in ("true_x", "true_y", "true_z")] for k in good])
    flat = np.array([[float(wanted[k][name]) for name in ("true_x", "true_y", "true_z")] for k in good])
    # the map is about the middle of the control points: a scale of 1e-9, an azimuth of 1e-5
    np.testing.assert_allclose(restated.restated(found, "EPSG:4326", restated.MAP), flat, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("system", [pytest.param("EPSG:4326", marks=pytest.mark.slow), "EPSG:32620"])
def test_points_in_a_system_of_proj(job: Path, system: str) -> None:
    assert musat(job / "mapped.csv", job / "true.csv", "-o", job / "local.csv", *FAST).exit_code == 0
    rows = table(job / "mapped.csv")
    flat = np.array([[float(row[name]) for name in "xyz"] for row in rows])
    places = restated.restated(flat, restated.MAP, system).tolist()
    write(job / "bent.csv", "id,x,y,z", [(row["id"], *place) for row, place in zip(rows, places, strict=True)])
    result = musat(job / "bent.csv", job / "true.csv", "-o", job / "out.csv", "--crs", system, *FAST)
    assert result.exit_code == 0, result.output
    heights = [[float(row["true_z"]) for row in table(job / name)] for name in ("out.csv", "local.csv")]
    np.testing.assert_allclose(heights[0], heights[1], atol=1e-3)


def test_a_deck_in_latitudes_wants_points_in_them(job: Path) -> None:
    deck = job / "job.crd"
    text = (ROOT / "fixtures" / "st_thomas" / "st_thomas.crd").read_text()
    deck.write_text(text)
    result = musat(job / "mapped.csv", deck, "-o", job / "out.csv")
    assert result.exit_code == 1 and "no check point under water has a height" in result.output
    geocentric = musat(job / "mapped.csv", job / "dz.csv", "-o", job / "out.csv", "--crs", "EPSG:4978")
    assert geocentric.exit_code == 2 and "geocentric has no heights" in geocentric.output


def las(job: Path) -> Path:
    import laspy

    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, header.offsets = [0.001] * 3, [0.0] * 3
    cloud = laspy.LasData(header)
    rows = [[float(row[name]) for name in "xyz"] for row in table(job / "mapped.csv")]
    cloud.x, cloud.y, cloud.z = np.array([*rows, [5000.0, 0.0, -8.0]]).T
    cloud.intensity = np.arange(101)
    cloud.write(job / "cloud.las")
    return job / "cloud.las"


@pytest.mark.slow
def test_a_las_file_comes_out_with_extra_dimensions(job: Path) -> None:
    source = las(job)
    result = musat(source, job / "dz.csv", "-o", job / "out.las", *FAST)
    assert result.exit_code == 0, result.output
    assert "101 points, 100 corrected" in result.output
    cloud = __import__("laspy").read(job / "out.las")
    musat(job / "mapped.csv", job / "dz.csv", "-o", job / "out.csv", *FAST)
    expected = np.array([float(row["true_z"]) for row in table(job / "out.csv")])
    # the file has heights to a millimetre, out of mapped ones to a millimetre
    assert np.abs(np.asarray(cloud.z)[:100] - expected).max() < 1.1e-3
    assert cloud.z[100] == cloud["apparent_z"][100] == -8.0
    assert cloud["reason"].tolist() == [0] * 100 + [11]
    assert np.nanmax(np.abs(np.asarray(cloud.z) - cloud["apparent_z"] - cloud["correction"])) < 1e-3
    assert np.isnan(cloud["correction"][100])
    assert cloud.intensity.tolist() == list(range(101))


@pytest.mark.slow
def test_las_files_that_cannot_be_used(job: Path) -> None:
    source = las(job)
    assert musat(source, job / "dz.csv", "-o", job / "out.csv", *FAST).exit_code == 0
    result = musat(source, job / "true.csv", "-o", job / "out.las", *FAST)
    assert result.exit_code == 2 and "have no ids" in result.output
