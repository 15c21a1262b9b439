"""Points corrected by the record of a run, local or restated in any system."""

import json
import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest
from click.testing import Result
from scipy.spatial.transform import Rotation

from cli.commands import musat
from depth import restated
from depth.lagoon import FOLDER as LAGOON
from depth.lagoon import rows
from json_schema import load_schema
from musatpy.depth.cameras import Tilt, read_run
from musatpy.depth.correction import Correction
from musatpy.errors import RecordError
from musatpy.geometry.collinearity import attitude_matrix
from musatpy.geometry.geodesy import Ellipsoid, GeocentricFrame, surface
from musatpy.geometry.projected import Projected
from musatpy.geometry.systems import Geocentric
from musatpy.model import CoordinateSystem, Refraction
from musatpy.reports.record import dumps, record
from record_rows import with_columns, with_rows
from sample_solutions import sample_solution

INDEX = 1.3398
WAVE = dict.fromkeys(load_schema()["properties"]["waves"]["required"], 1.0) | {"wave": "1", "shape": "stokes"}


def lagoon_run() -> dict[str, Any]:
    """The record of a run in local coordinates, with the stations of the lagoon in place of its own."""
    run = with_rows(json.loads(dumps(record(sample_solution(CoordinateSystem.LOCAL, Refraction.WATPT)))))
    cameras = rows(LAGOON / "cameras.csv")
    run["solution"]["converged"] = True
    run["cameras"] = [run["cameras"][0] | {"camera": "RC8", "focal_length": 152.4, "format_size": [228.6, 228.6]}]
    run["stations"] = [
        run["stations"][0]
        | {
            "photo": row["name"],
            "camera": "RC8",
            "position": [float(row[axis]) for axis in "xyz"],
            "attitude": np.radians([float(row[angle]) for angle in ("omega", "phi", "kappa")]).tolist(),
        }
        for row in cameras
    ]
    run["waves"] = []
    tides = [float(row["tide"]) for row in cameras]
    run["adjusted_water"] |= {"tide": tides, "tilt": [0.0, 0.0], "index": INDEX}
    return dict(run)


def written(tmp_path: Path, run: Any) -> Path:
    path = tmp_path / "run.json"
    path.write_text(json.dumps(with_columns(run)))
    return path


def test_cameras_behind_a_port_are_refused(tmp_path: Path) -> None:
    run = lagoon_run()
    port = {"distance": 35.0, "thickness": 10.0, "glass_index": 1.49, "water_index": 1.34, "tilt": [0.0, 0.0]}
    run["ports"] = [{"camera": "RC8", **port}]
    with pytest.raises(RecordError, match="camera RC8 is behind a port"):
        read_run(written(tmp_path, run))


def test_a_run_corrects_as_the_file_of_its_stations(tmp_path: Path) -> None:
    """The index is that of the run too, unless another is given."""
    run = written(tmp_path, lagoon_run())
    stations = ("--focal", "152.4", "--format", "228.6,228.6", "--index", str(INDEX))
    sources = {"run": (str(run),), "csv": (str(LAGOON / "cameras.csv"), *stations)}
    for name, source in sources.items():
        words = ("depth", "correct", LAGOON / "points.csv", "-o", tmp_path / f"{name}.csv", "--jobs", 1)
        result = musat(*words, "--cameras", *source)
        assert result.exit_code == 0, result.output
    assert (tmp_path / "run.csv").read_bytes() == (tmp_path / "csv.csv").read_bytes()
    table = musat("depth", "table", "--cameras", run, "--depths", "5")
    assert table.output.startswith("8 stations, n = 1.33980, by rays")
    other = musat("depth", "table", "--cameras", run, "--index", "1.33", "--depths", "5")
    assert other.output.startswith("8 stations, n = 1.33000, by rays")


def test_a_camera_without_format_gets_that_of_the_options(tmp_path: Path) -> None:
    run = lagoon_run()
    run["cameras"][0]["format_size"] = [None, None]
    path = written(tmp_path, run)
    words = ("depth", "correct", LAGOON / "points.csv", "-o", tmp_path / "true.csv", "--cameras", path, "--jobs", 1)
    assert "what a camera sees is not known" in musat(*words).output
    assert "63 corrected" in musat(*words, "--focal", 150, "--format", "228.6,228.6").output  # focal: of the run


@pytest.mark.parametrize(
    ("table", "changes", "message"),
    [
        ("program", {"name": "other"}, 'program.name: expected "musatpy", found "other"'),
        ("solution", {"converged": False}, "the run has not converged"),
        ("options", {"system": "GEOG"}, "a GEOG job needs an ellipsoid"),
        ("options", {"initial": "COMPUTE"}, "the water of the run is tilted, about a place that is known where"),
        ("adjusted_water", {"index": 1.45}, "1.45 is not within 1.3 to 1.4, as that of water is"),
        ("adjusted_water", {"tide": [None, 0.3, None, *[0.2] * 5]}, "no tide of photo 101, 103\n"),
        ("adjusted_water", {"tide": [2000.0] * 8}, "station 1 is not above the water"),
        ("adjusted_water", None, "the run knows no water"),
        ("waves", [WAVE], "the water of the run has waves, here it is still"),
    ],
)
def test_a_run_that_cannot_be_used_says_why(tmp_path: Path, table: str, changes: Any, message: str) -> None:
    run = lagoon_run()
    run["adjusted_water"]["tilt"] = [1e-4, 0.0]
    run[table] = {**run[table], **changes} if isinstance(changes, dict) else changes
    result = correct(LAGOON / "points.csv", written(tmp_path, run), target=tmp_path / "true.csv")
    assert result.exit_code == 1 and message in result.output, result.output


def test_tilted_water_is_level_water_turned(tmp_path: Path) -> None:
    """The lagoon with all that is in it turned by some milliradians: true points are the turned ones."""
    run, turn = lagoon_run(), Rotation.from_rotvec([2e-3, -3e-3, 0.0]).as_matrix()
    given = np.array([row["position"] for row in run["stations"]])
    normal = turn[:, 2]
    pivot = np.rint((given @ turn.T).mean(axis=0))  # the adjustment tilts water about the stations, to a metre
    for row, place in zip(run["stations"], given @ turn.T, strict=True):
        row["position"], row["given_position"] = place.tolist(), place.tolist()
        row["attitude"] = (
            Rotation.from_matrix((attitude_matrix(np.array(row["attitude"])) @ turn.T).T).as_euler("XYZ").tolist()
        )
    water = run["adjusted_water"]
    water["tilt"] = (-normal[:2] / normal[2]).tolist()
    water["tide"] = [(tide - normal[:2] @ pivot[:2]) / normal[2] for tide in water["tide"]]
    cameras = read_run(written(tmp_path, run))
    level = Correction(cameras=read_run(written(tmp_path, lagoon_run())), index=INDEX)
    apparent = np.array([[float(row[axis]) for axis in "xyz"] for row in rows(LAGOON / "points.csv")])
    found, seen = Correction(cameras=cameras, index=INDEX)(apparent @ turn.T)
    wanted, seen_level = level(apparent)
    np.testing.assert_array_equal(seen, seen_level)
    np.testing.assert_array_equal(found.fault, wanted.fault)
    # a level counts along the normal as it does along the vertical: 1e-5 of a tide of 4 m at the pivot
    np.testing.assert_allclose(found.position, wanted.position @ turn.T, atol=1e-4)
    np.testing.assert_allclose(found.depth, wanted.depth, rtol=1e-5)  # along the vertical, and across the water


# What is asked for. Rays end at 1e-6 m, coordinates are written to 1e-4 m or 1e-9 degrees, and the plane across the
# vertical of the apparent point leaves the level surface by 1e-5 m where the rays meet it
NEAR = 1e-3
SYSTEMS = {
    "geographic": "EPSG:4326",
    "utm": "EPSG:32620",
    "geocentric": "EPSG:4978",
    "conic": "+proj=lcc +lat_1=18 +lat_2=19 +lon_0=-66 +ellps=WGS84",
    "feet": "+proj=utm +zone=20 +ellps=WGS84 +units=us-ft",
}


def run_on_the_ellipsoid(system: str = "GEOG") -> dict[str, Any]:
    """The record of the lagoon with its stations on the ellipsoid."""
    run = lagoon_run()
    run["options"]["system"], run["stated"] = system, None
    run["ellipsoid"] = {"name": "WGS84", "semi_major_axis": None, "inverse_flattening": None}
    for row, station in zip(run["stations"], restated.stations(), strict=True):
        assert row["photo"] == station.name
        row["position"] = (station.level if system == "GEOG" else station.place).tolist()
    return run


def apparent(system: str) -> np.ndarray:
    return restated.restated(np.array([place for *_, place in restated.points()]), restated.GEOCENTRIC, system)


def on_the_map(places: np.ndarray, system: str) -> np.ndarray:
    """Places of a system as x, y, z of the lagoon."""
    return restated.restated(places, system, restated.MAP)


def truth() -> np.ndarray:
    return np.array([place for _, place, _ in restated.points()])


def points_file(tmp_path: Path, system: str) -> Path:
    path = tmp_path / "points.csv"
    places = zip((name for name, *_ in restated.points()), apparent(system).tolist(), strict=True)
    path.write_text("id,x,y,z\n" + "".join(f"{name},{x:.12g},{y:.12g},{z:.6f}\n" for name, (x, y, z) in places))
    return path


def correct(points: Path, run: Path, *options: str, target: Path | None = None) -> Result:
    out = target or points.with_stem("true")
    return musat("depth", "correct", points, "-o", out, "--cameras", run, "--jobs", 1, *options)


def misses(path: Path, system: str) -> np.ndarray:
    """How far corrected points (n, 3) of a file are from the truth, m; NaN for one that is not corrected."""
    found = np.array([[float(row[f"true_{axis}"] or "nan") for axis in "xyz"] for row in rows(path)])
    good = np.isfinite(found).all(axis=1)
    out = np.full(found.shape, np.nan)
    out[good] = on_the_map(found[good], system) - truth()[good]
    return out


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["GEOG", "GEOC"])
@pytest.mark.parametrize("system", SYSTEMS)
def test_points_in_any_system_are_those_of_the_local_job(tmp_path: Path, kind: str, system: str) -> None:
    points = points_file(tmp_path, SYSTEMS[system])
    result = correct(points, written(tmp_path, run_on_the_ellipsoid(kind)), "--crs", SYSTEMS[system])
    assert result.exit_code == 0, result.output
    missed = misses(tmp_path / "true.csv", SYSTEMS[system])
    good = np.isfinite(missed).all(axis=1)
    assert good.sum() == 63  # as many as in the local job
    assert np.abs(missed[good]).max() < NEAR
    assert "points taken as" in result.output


@pytest.mark.slow
def test_the_system_of_the_answer_is_that_of_the_points(tmp_path: Path) -> None:
    """A SYS card of the deck says it for the run, and so for its points."""
    run = run_on_the_ellipsoid()
    words = {"kind": "PROJ", "definition": "EPSG:32620", "geoid": None, "origin": None, "false_origin": None}
    words |= {"axes": "VERT", "angles": "OPK", "unit": "DMS", "sigmas": "LOCL", "text": ""}
    words |= {"coordinates": ["E", "N", "H"], "coordinate_units": ["m"] * 3}
    run["stated"] = {"input": None, "answer": words, "stations": [], "points": []}
    result = correct(points_file(tmp_path, "EPSG:32620"), written(tmp_path, run))
    assert result.output.splitlines()[-1] == (
        "points taken as WGS 84 / UTM zone 20N, EPSG:32620, ellipsoidal heights"
    )
    assert np.nanmax(np.abs(misses(tmp_path / "true.csv", "EPSG:32620"))) < NEAR


@pytest.fixture
def geoid(tmp_path: Path) -> Path:
    """A grid of a geoid 40 m below the ellipsoid and more to the east."""
    values = -40.0 - 0.5 * np.arange(5.0) + np.zeros((5, 1))
    path = tmp_path / "geoid.gtx"
    head = np.array([17.0, -66.0, 0.5, 0.5]).astype(">f8").tobytes() + np.array([5, 5]).astype(">i4").tobytes()
    path.write_bytes(head + values.astype(">f4").tobytes())
    return path


@pytest.mark.slow
def test_heights_above_a_geoid(tmp_path: Path, geoid: Path) -> None:
    """Points lower by the geoid come out lower by it, in a map and in longitude and latitude."""
    run = written(tmp_path, run_on_the_ellipsoid())
    for system in ("EPSG:32620", "EPSG:4326", "EPSG:32620+5773"):
        plane = system.partition("+")[0]
        source = points_file(tmp_path, plane)
        cells = [line.split(",") for line in source.read_text().splitlines()]
        undulation = -40.0 - (restated.LONGITUDE + 66.0)
        lines = [",".join([*row[:3], f"{float(row[3]) - undulation:.6f}"]) for row in cells[1:]]
        source.write_text("\n".join([",".join(cells[0]), *lines]))
        result = correct(source, run, "--crs", system, "--geoid", str(geoid))
        assert result.exit_code == 0, result.output
        missed = misses(tmp_path / "true.csv", plane)
        # the geoid slopes by 1 m per degree: 1 cm over the lagoon, which the water follows no more than the heights
        np.testing.assert_allclose(np.nanmean(missed[:, 2]), -undulation, atol=0.02)
        assert np.nanmax(np.abs(missed[:, :2])) < 0.02
    alone = correct(source, run, "--crs", "EPSG:32620+5773")
    assert alone.exit_code == 1
    assert "has EGM96 height: the grid file of its geoid model is needed (--geoid)" in alone.output


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--crs", "EPSG:32619"), "no camera sees any of its 65 points: are they in the system of the job?"),
        (("--crs", "EPSG:99999"), "EPSG:99999 is no coordinate system that PROJ knows"),
        ((), "longitude and latitude in degrees, ellipsoidal heights: x 297560.6866, y"),
        (("--geoid", "here.gtx"), "--geoid goes with --crs"),
    ],
)
def test_points_in_another_system_are_told(tmp_path: Path, options: tuple[str, ...], message: str) -> None:
    points = points_file(tmp_path, "EPSG:32620")
    result = correct(points, written(tmp_path, run_on_the_ellipsoid()), *options)
    assert result.exit_code in (1, 2)
    assert message in result.output
    assert "Traceback" not in result.output and not (tmp_path / "true.csv").exists()


def test_a_local_run_has_no_other_system(tmp_path: Path) -> None:
    result = correct(LAGOON / "points.csv", written(tmp_path, lagoon_run()), "--crs", "EPSG:32620")
    assert result.exit_code == 1 and "have a place on the ellipsoid" in result.output


@pytest.mark.slow
def test_a_coordinate_that_is_missing_is_a_reason_of_its_point(tmp_path: Path) -> None:
    points = points_file(tmp_path, "EPSG:4978")
    lines = points.read_text().splitlines()
    points.write_text("\n".join([*lines[:3], "none,,,", "nan,nan,1,2"]))
    result = correct(points, written(tmp_path, run_on_the_ellipsoid()), "--crs", "EPSG:4978")
    assert "4 points, 2 corrected" in result.output
    assert "2 not corrected: a coordinate is no number" in result.output


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "stated", "words"), [("las", 32620, ()), ("laz", 32619, ("--crs", "EPSG:32620"))])
def test_a_las_file_keeps_its_own_system_or_gets_that_which_is_named(
    tmp_path: Path, kind: str, stated: int, words: tuple[str, ...]
) -> None:
    import laspy

    header = laspy.LasHeader(version="1.4", point_format=6)
    header.add_crs(pyproj.CRS(stated))
    header.scales, header.offsets = np.full(3, 1e-4), apparent("EPSG:32620").mean(axis=0).round()
    las = laspy.LasData(header)
    las.x, las.y, las.z = apparent("EPSG:32620").T
    source = tmp_path / f"points.{kind}"
    las.write(source)
    result = correct(source, written(tmp_path, run_on_the_ellipsoid()), *words)
    assert result.exit_code == 0, result.output
    found = laspy.read(tmp_path / f"true.{kind}")
    good = np.asarray(found.reason) == 0
    assert good.sum() == 63
    assert np.abs(on_the_map(np.asarray(found.xyz), "EPSG:32620") - truth())[good].max() < NEAR
    assert found.header.parse_crs() == pyproj.CRS("EPSG:32620")


def test_processes_make_the_same_file(tmp_path: Path) -> None:
    """Maps and geoids of PROJ are made anew in other processes."""
    system = Projected("EPSG:32620", Ellipsoid("WGS84"))
    again = pickle.loads(pickle.dumps(system))
    place = np.array([[0.32, -1.133, 5.0]])
    np.testing.assert_array_equal(again.coordinates(place), system.coordinates(place))


@pytest.mark.slow
def test_the_water_over_a_point_is_that_of_the_adjustment(tmp_path: Path) -> None:
    """Plane and depth over points of a geographic job with tilted water, by both."""
    ellipsoid = Ellipsoid("WGS84")
    level = np.array([restated.geographic(place) for place in truth()])
    pivot, tide = np.rint(ellipsoid.geocentric(level).mean(axis=0)), 0.4
    frame = GeocentricFrame(pivot, ellipsoid)
    slope = np.array([2e-4, -3e-4]) @ frame.axes(np.zeros(3))[:2]
    over = surface(frame, slope, np.full(len(level), tide), frame.from_level(level))
    cameras = replace(read_run(written(tmp_path, run_on_the_ellipsoid())), tilt=Tilt(slope=slope, pivot=pivot))
    ground = Correction(cameras=cameras, index=INDEX, system=Geocentric(ellipsoid))
    placed = ground.placed(ellipsoid.geocentric(level))
    assert placed.verticals is not None
    np.testing.assert_allclose(placed.verticals.axes[:, 2], over.normal, atol=1e-12)
    np.testing.assert_allclose(tide - placed.upright[:, 2], over.depth, atol=1e-5)  # 1 / cos of the tilt
    back = ground.restated(placed.upright, placed.verticals)
    np.testing.assert_allclose(back, ellipsoid.geocentric(level), atol=1e-8)


def test_factors_over_a_model_on_the_ellipsoid(tmp_path: Path) -> None:
    """About the middle of the stations they are those of the local job there."""
    x, y = np.array([[row["position"][axis] for axis in (0, 1)] for row in lagoon_run()["stations"]]).mean(axis=0)
    tables = []
    for run, (east, north) in ((run_on_the_ellipsoid(), (0.0, 0.0)), (lagoon_run(), (x, y))):
        area = f"{east - 400},{north - 200},{east + 400},{north + 200}"
        path = written(tmp_path, run)
        result = musat("depth", "table", "--cameras", path, f"--area={area}", "--grid", "3,3", "--depths", "2,8")
        assert result.exit_code == 0, result.output
        lines = result.output.splitlines()
        assert len(lines) == (12 if east == 0.0 else 11)  # a line says where x and y are
        tables.append([[float(value) for value in line.split()[2:]] for line in lines[-9:]])
    np.testing.assert_allclose(*tables, atol=2e-4)  # four decimals, and 1e-5 of the distances
