"""Points of the lagoon corrected by `musat correct`: against the truth, in every format, and unusable files."""

import datetime
import uuid
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest
from click.testing import Result

from cli.commands import musat
from depth import lagoon
from depth.lagoon import rows
from musatpy.depth.cameras import read_cameras

FOLDER = lagoon.FOLDER
POINTS, CAMERAS = FOLDER / "points.csv", FOLDER / "cameras.csv"
FORMAT = ("--focal", lagoon.FOCAL, "--format", f"{lagoon.FORMAT},{lagoon.FORMAT}")
# Apparent coordinates end at 0.1 mm. Half of that is 0.08 mm of depth by F < 1.6; where a point has left the place
# where its rays meet, its true point leaves it along them by some times as much
NEAR = 5.0e-4
NUMBERS = ("true_x", "true_y", "true_z", "depth", "factor", "spread", "incidence", "largest_incidence")


def correct(source: Path, target: Path, *options: object, stations: Path = CAMERAS, jobs: int = 1) -> Result:
    """Return what became of a file of points; the cameras have their format where no options say more."""
    rule = options or FORMAT
    words = ("--stations", stations, "--index", lagoon.INDEX, "--jobs", jobs)
    return musat("correct", source, "-o", target, *words, *rule)


def xyz_of(table: list[dict[str, str]], prefix: str = "") -> np.ndarray:
    return np.array([[float(row[prefix + axis] or "nan") for axis in "xyz"] for row in table])


@pytest.fixture(scope="module")
def corrected(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    target = tmp_path_factory.mktemp("lagoon") / "true.csv"
    result = correct(POINTS, target)
    table = rows(target)
    good = [row for row in table if not row["reason"]]
    # the tally is that of the table
    assert result.exit_code == 0 and f"{len(table)} points, {len(good)} corrected" in result.output
    deepest, spread = (max(float(row[name]) for row in good) for name in ("depth", "spread"))
    mean = np.mean([float(row["factor"]) for row in good])
    assert f"mean factor {mean:.4f}, deepest {deepest:.3f} m, largest spread" in result.output
    assert f"among cameras {spread:.3f} m" in result.output
    return table


def test_the_fixture_is_what_its_script_makes() -> None:
    for name, text in lagoon.files().items():
        assert (FOLDER / name).read_text() == text


def test_true_points_are_the_truth(corrected: list[dict[str, str]]) -> None:
    truth = {row["point"]: row for row in rows(FOLDER / "truth.csv")}
    tides = {row["name"]: float(row["tide"]) for row in rows(CAMERAS)}
    good = [row for row in corrected if not row["reason"]]
    assert len(good) > 60
    np.testing.assert_allclose(xyz_of(good, "true_"), xyz_of([truth[row["point"]] for row in good]), atol=NEAR)
    for row in corrected:
        assert row["cameras"] == truth[row["point"]]["photos"]
    for row in good:
        level = np.mean([tides[name] for name in row["cameras"].split()])
        depth, apparent = float(row["depth"]), level - float(row["z"])
        assert depth == pytest.approx(level - float(row["true_z"]), abs=2e-4)
        assert depth / apparent == pytest.approx(float(row["factor"]), abs=1e-4)


def test_every_point_has_numbers_or_a_reason(corrected: list[dict[str, str]]) -> None:
    for row in corrected:
        numbers = [row[name] for name in NUMBERS]
        assert set(numbers) == {""} if row["reason"] else np.isfinite([float(number) for number in numbers]).all()
    reasons = {row["point"]: row["reason"] for row in corrected if row["reason"]}
    assert reasons.pop("ROCK") == "not below the water"
    assert reasons.pop("AWASH") == "between the tides of its cameras"
    assert reasons.pop("OFF") == "no camera sees it"
    assert set(reasons.values()) == {"only one camera sees it"}


@pytest.mark.slow
def test_processes_and_chunks_make_the_same_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of several chunks, with columns in another order, other columns, a quoted text and blank lines."""
    monkeypatch.setattr("musatpy.pointfiles.point_tables.CHUNK", 1000)
    points = np.random.default_rng(5).uniform((0, 0, -15), (1500, 900, 1), (2100, 3)).round(3)
    lines = [f'{z},"no. {i}, é",{x},{y}\n' + ("\n" if i % 999 == 0 else "") for i, (x, y, z) in enumerate(points)]
    source, outputs = tmp_path / "many.csv", [tmp_path / "1.csv", tmp_path / "2.csv"]
    source.write_text("Z,text,X,Y\n" + "".join(lines))
    results = [correct(source, out, jobs=jobs) for jobs, out in enumerate(outputs, 1)]
    assert outputs[0].read_bytes() == outputs[1].read_bytes()
    assert all("2100 points, " in result.output for result in results)
    assert [row["text"] for row in rows(outputs[0])] == [row["text"] for row in rows(source)]


@pytest.mark.parametrize(
    ("text", "messages"),
    [
        ("x,y,z\n1,2,-3\n\n1,two,-3\n", ("points.csv:4 cols 3-5 y: 'two' is not a number",)),
        (
            "x,y,z\n9000,300,-3\n9100,300,5\nnan,,\n",  # one that is off has a reason; all are in another system
            (
                "no camera sees any of its 2 points: are they in the system of the job? They were taken as local",
                "The middle of the stations is X 806.8452, Y 449.5122, Z 899",
            ),
        ),
    ],
)
def test_points_that_cannot_be_used_leave_no_file(tmp_path: Path, text: str, messages: tuple[str, ...]) -> None:
    source = tmp_path / "points.csv"
    source.write_text(text)
    result = correct(source, tmp_path / "out.csv")
    assert result.exit_code == 1 and all(message in result.output for message in messages), result.output
    assert not list(tmp_path.glob("*out.csv*"))  # not even half a file


def test_a_coordinate_that_is_no_number_is_a_reason(tmp_path: Path) -> None:
    source, out = tmp_path / "points.csv", tmp_path / "out.csv"
    source.write_text("x,y,z\n500,400,nan\n500,400,-3\n500,400,\n , ,\n500,inf,-3\n9000,300,-3\n")
    assert correct(source, out).exit_code == 0
    why = "a coordinate is no number"
    assert [row["reason"] for row in rows(out)] == [why, "", why, why, "no camera sees it"]
    source.write_text("x,y,z")
    assert "0 points, 0 corrected" in correct(source, out).output
    assert out.read_text().splitlines() == [
        "x,y,z,true_x,true_y,true_z,depth,factor,cameras,spread,incidence,largest_incidence,reason"
    ]


def cloud(path: Path, xyz: np.ndarray, scale: float, version: str = "1.4", point_format: int = 6) -> laspy.LasData:
    """Write points as a cloud with numbers of its own, and return it."""
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.scales, header.offsets = np.full(3, scale), np.zeros(3)
    header.add_extra_dim(laspy.ExtraBytesParams(name="quality", type="f4"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.intensity, las.quality = np.arange(len(xyz)), np.arange(len(xyz)) / 7.0
    las.write(path)
    return las


def bits_of(las: laspy.LasData, cameras: int) -> np.ndarray:
    """Return (n, k) which cameras see the points of a cloud."""
    words = [np.asarray(las[f"camera_bits_{camera // 64}"]) >> np.uint64(camera % 64) for camera in range(cameras)]
    return np.stack(words, axis=1) & np.uint64(1) == 1


def named(table: list[dict[str, str]], names: list[str]) -> np.ndarray:
    return np.array([[name in row["cameras"].split() for name in names] for row in table])


def test_las_has_the_same_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, corrected: list[dict[str, str]]
) -> None:
    monkeypatch.setattr("musatpy.pointfiles.las_files.CHUNK", 50)
    xyz = xyz_of(corrected)
    assert len(xyz) > 50  # more than a chunk
    las = cloud(tmp_path / "in.laz", xyz, 1e-4)
    for jobs in (1, 2):
        assert correct(tmp_path / "in.laz", tmp_path / f"{jobs}.las", jobs=jobs).exit_code == 0
    found, again = (laspy.read(tmp_path / f"{jobs}.las") for jobs in (1, 2))
    assert (found.points.array == again.points.array)[np.asarray(found.reason) == 0].all()
    good = np.array([not row["reason"] for row in corrected])
    np.testing.assert_array_equal(np.asarray(found.reason) == 0, good)
    # half a unit of the scale, half of that of the points given, and half a digit of the table
    np.testing.assert_allclose(np.asarray(found.xyz)[good], xyz_of(corrected, "true_")[good], atol=2.5e-4)
    np.testing.assert_allclose(np.asarray(found.xyz)[~good], xyz[~good], atol=1e-4)
    np.testing.assert_allclose(found.apparent_z, xyz[:, 2], atol=1e-4)
    for name in ("depth", "factor", "spread"):
        table = [float(row[name]) for row in corrected if not row["reason"]]
        np.testing.assert_allclose(np.asarray(found[name])[good], table, atol=3e-4)
    seen = named(corrected, [name for name, _ in lagoon.stations()])
    np.testing.assert_array_equal(bits_of(found, 8), seen)
    np.testing.assert_array_equal(found.cameras, seen.sum(axis=1))
    np.testing.assert_array_equal(found.intensity, np.asarray(las.intensity))
    np.testing.assert_array_equal(found.quality, np.asarray(las.quality))
    assert "there is a dimension" in correct(tmp_path / "1.las", tmp_path / "3.las").output


def test_las_has_a_bit_for_each_of_many_cameras(tmp_path: Path) -> None:
    stations, points = tmp_path / "stations.csv", tmp_path / "points.csv"
    lines = [f"{row},{x:.1f},0,900,0" for row, x in enumerate(np.linspace(0.0, 6900.0, 70))]
    stations.write_text("\n".join(["name,x,y,z,tide", *lines, ""]))
    points.write_text("x,y,z\n100,0,-5\n6350,30,-4\n6800,0,-3\n")
    cloud(tmp_path / "in.las", xyz_of(rows(points)), 1e-3, "1.2", 0)
    for source, target in ((tmp_path / "in.las", tmp_path / "out.las"), (points, tmp_path / "out.csv")):
        assert correct(source, target, "--angle", 30, stations=stations).exit_code == 0
    seen = named(rows(tmp_path / "out.csv"), [str(row) for row in range(70)])
    np.testing.assert_array_equal(bits_of(laspy.read(tmp_path / "out.las"), 70), seen)
    assert seen[1, 60:66].any() and seen[2, 64:].any()


# --- cameras ---


def test_a_camera_sees_its_format_and_its_angle(tmp_path: Path, corrected: list[dict[str, str]]) -> None:
    """The images of the truth decide, not the formula that is tested."""
    points, cameras = xyz_of(corrected), lagoon.stations()
    names = [name for name, _ in cameras]
    images = np.array([[lagoon.straight(camera, point) for _, camera in cameras] for point in points])
    gap = points[:, None] - np.array([camera[:3] for _, camera in cameras])
    inside = (gap[..., 2] < 0.0) & (np.abs(images).max(axis=2) <= lagoon.FORMAT / 2.0)
    np.testing.assert_array_equal(named(corrected, names), inside)
    off = np.degrees(np.arctan2(np.hypot(gap[..., 0], gap[..., 1]), -gap[..., 2]))
    correct(POINTS, tmp_path / "true.csv", "--angle", 25)
    np.testing.assert_array_equal(named(rows(tmp_path / "true.csv"), names), off <= 25.0)


def test_attitudes_as_metashape_has_them(tmp_path: Path) -> None:
    """Its table of stations: a nose that is up looks forward, a right wing that is down looks to the left."""
    path = tmp_path / "stations.csv"
    rows = "a,1,2,90,0,0,0\nb,1,2,90,90,30,0\nc,1,2,90,0,0,20\nd,1,2,90,90,0,20\n"
    path.write_text("#Label,X/Easting,Y/Northing,Z/Altitude,Yaw,Pitch,Roll,\n" + rows.replace("\n", ",\n"))
    M = read_cameras(path, level=0.0).rotation
    assert M is not None
    s, c = np.sin(np.radians([30.0, 20.0])), np.cos(np.radians([30.0, 20.0]))
    looking = [[0, 0, -1], [s[0], 0, -c[0]], [-s[1], 0, -c[1]], [0, s[1], -c[1]]]
    np.testing.assert_allclose(-M[:, 2], looking, rtol=0, atol=1e-12)
    np.testing.assert_allclose(M[[0, 1, 2, 3], 1], [[0, 1, 0], [c[0], 0, s[0]], [0, 1, 0], [1, 0, 0]], atol=1e-12)


WITH_CAMERA = "name,x,y,z,tide,omega,phi,kappa,focal,width,height\n1,0,0,900,0,0,0,0,152,230,230\n"


@pytest.mark.parametrize(
    ("text", "options", "messages"),
    [
        ("name,x,y,z\n1,0,0,900\n", (), ("cameras.csv:1: ", "no column tide, and no water level is given")),
        ("name,x,y,z,tide,omega\n", (), ("cameras.csv:1: ", "omega, phi, kappa go together: only omega found")),
        ("name,x,y,z,tide,rol\n", (), ("cameras.csv:1: ", "unknown column rol")),
        ("name,x,y,z,tide,roll\n", (), ("cameras.csv:1: ", "roll, pitch, yaw go together: only roll found")),
        ("name,x,y,z,tide,omega,phi,kappa,roll,pitch,yaw\n", (), ("roll, pitch, yaw: one is meant",)),
        ("# Label,X/Longitude,Y/Latitude,Z/Altitude\n1,5,6,9\n", (), ("no column x [m] among Label, X/Longitude",)),
        # height is that of the format
        ("name,x,y,height,tide\n", (), ("cameras.csv:1: ", "no column z [m] among name, x, y, height")),
        ("name,x,y,z,tide\n", (), ("no station",)),
        ("name,x,y,z,tide\n1,0,0,900,901\n", (), ("cameras.csv:2 ", "the water at 901 m is not below the station")),
        ("name,x,y,z,tide\na b,0,0,900,0\n", (), ("cameras.csv:2 ", "a name without blanks")),
        (
            "name,x,y,z,tide,focal,width,height\n1,0,0,900,0,0,230,230\n",
            (),
            ("cameras.csv:2 ", "focal: '0' is not a number gr"),
        ),
        ("name,x,y,z,tide,focal,width,height\n1,0,0,900,0,152,230,230\n", (), ("a format needs attitudes",)),
        ("name,x,y,z\n1,0,0,900\n2,0,0,80\n", ("--level", 100), ("station 2 is not above the water",)),
        (
            WITH_CAMERA,
            ("--level", 0, *FORMAT),
            (
                "there is a column tide, and a water level is given too: one or the other",
                "there is a column focal, and a camera is given too: one or the other",
            ),
        ),
    ],
)
def test_a_file_of_cameras_that_cannot_be_used(
    tmp_path: Path, text: str, options: tuple[object, ...], messages: tuple[str, ...]
) -> None:
    path = tmp_path / "cameras.csv"
    path.write_text(text)
    result = correct(POINTS, tmp_path / "out.csv", "--angle", 40, *options, stations=path)
    assert result.exit_code == 1 and str(path) in result.output
    assert all(message in result.output for message in messages), result.output


# --- everything that a cloud may have ---

COUNT = 300


def given(path: Path, version: str, point_format: int) -> Any:
    """Write a file with everything that a header can have, and return it."""
    rng = np.random.default_rng(3)
    header = laspy.LasHeader(version=version, point_format=point_format)
    header.scales, header.offsets = np.full(3, 1e-3), np.array([500.0, 100.0, -10.0])
    header.system_identifier, header.generating_software, header.file_source_id = "SCANNER", "MAKER", 77
    header.creation_date, header.uuid = datetime.date(2020, 2, 3), uuid.UUID(int=5)
    scaled = laspy.ExtraBytesParams(
        name="amplitude", type="u2", scales=np.array([0.01]), offsets=np.array([5.0]), description="scaled"
    )
    header.add_extra_dims([scaled, laspy.ExtraBytesParams(name="normal", type="3f8")])
    header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr('LOCAL_CS["lagoon"]'))
    header.vlrs.append(laspy.VLR(user_id="someone", record_id=7, description="his", record_data=b"abc"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = rng.uniform((0, 0, -15), (1500, 900, 1), (COUNT, 3)).T
    las.intensity, las.return_number = np.arange(COUNT), np.ones(COUNT, dtype=int)
    las.gps_time = np.arange(COUNT) * 1.5
    las.amplitude, las.normal = 5.0 + 0.01 * np.arange(COUNT), rng.normal(size=(COUNT, 3))
    if version == "1.4":
        record = laspy.VLR(user_id="someone", record_id=9, description="long", record_data=b"much " * 99)
        las.evlrs = laspy.vlrs.vlrlist.VLRList([record])
    las.write(path)
    return laspy.read(path)


@pytest.mark.parametrize(
    ("version", "point_format", "kind"), [("1.2", 1, "las"), ("1.4", 6, "las"), ("1.4", 6, "laz")]
)
def test_header_records_and_dimensions_are_kept(tmp_path: Path, version: str, point_format: int, kind: str) -> None:
    las = given(tmp_path / f"in.{kind}", version, point_format)
    assert correct(tmp_path / f"in.{kind}", tmp_path / f"out.{kind}").exit_code == 0
    found = laspy.read(tmp_path / f"out.{kind}")
    for name in set(las.point_format.dimension_names) - set("XYZ"):
        np.testing.assert_array_equal(found[name], las[name])
    for name in ("version", "system_identifier", "generating_software", "file_source_id", "creation_date", "uuid"):
        assert getattr(found.header, name) == getattr(las.header, name)
    assert found.header.global_encoding.value == las.header.global_encoding.value
    np.testing.assert_array_equal(found.header.scales, las.header.scales)
    texts = [{v.user_id: v.record_data_bytes() for v in one.header.vlrs} for one in (found, las)]
    for user in ("LASF_Projection", "someone"):
        assert texts[0][user] == texts[1][user]
    if version == "1.4":
        assert [one.record_data for one in found.evlrs] == [b"much " * 99]


@pytest.mark.parametrize("kind", ["las", "laz"])
def test_files_that_are_cut_off_or_none_are_named(tmp_path: Path, kind: str) -> None:
    given(tmp_path / f"in.{kind}", "1.4", 6)
    whole = (tmp_path / f"in.{kind}").read_bytes()
    source = tmp_path / f"bad.{kind}"
    for data in (
        b"",
        b"x,y,z\n",
        b"LASF" + bytes(300),
        whole[:100],
        whole[: len(whole) // 2],
        whole[:600] + b"\xff" * 3000,
    ):
        source.write_bytes(data)
        result = correct(source, tmp_path / f"out.{kind}")
        assert result.exit_code == 1 and str(source) in result.output and "Traceback" not in result.output
        assert not list(tmp_path.glob("*out.*"))


def spoilt(path: Path, place: int, data: bytes) -> Path:
    content = bytearray(path.read_bytes())
    content[place : place + len(data)] = data
    path.write_bytes(content)
    return path


def test_names_of_the_header_are_kept_as_they_are(tmp_path: Path) -> None:
    """Latin-1 too, of which the specification knows nothing; names of dimensions are ASCII or UTF-8."""
    given(tmp_path / "in.las", "1.4", 6)
    correct(spoilt(tmp_path / "in.las", 26, b"B\xfcro"), tmp_path / "out.las")
    assert (tmp_path / "out.las").read_bytes()[26:30] == b"B\xfcro"
    amplitude = (tmp_path / "in.las").read_bytes().index(b"amplitude")
    result = correct(spoilt(tmp_path / "in.las", amplitude, b"h\xf6he"), tmp_path / "2.las")
    assert result.exit_code == 1 and "is no LAS file: 'utf-8' codec can't decode" in result.output


@pytest.mark.parametrize(
    ("place", "data", "message"),
    [
        (94, b"\xff\xff", "records before its points would not fit"),
        (96, b"\xff\xff\xff\x7f", "its header would not fit"),
        (100, b"\xff\xff\xff\xff", "records before its points would not fit"),
        (247, b"\xff\xff\xff\xff\xff\xff", "bytes would not fit"),
        (243, b"\xff\xff\xff\xff", "records behind its points would not fit"),
        (235, b"\xff\xff\xff\xff\xff\xff", "records behind its points would not fit"),
        (375 + 20, b"\xff\xff", "records before its points would not fit"),
        (131, b"\0\0\0\0\0\0\xf0\x7f", "scales or offsets are no numbers"),
    ],
)
def test_what_a_header_counts_must_fit_into_the_file(tmp_path: Path, place: int, data: bytes, message: str) -> None:
    given(tmp_path / "in.las", "1.4", 6)
    result = correct(spoilt(tmp_path / "in.las", place, data), tmp_path / "out.las")
    assert result.exit_code == 1 and message in result.output and not (tmp_path / "out.las").exists()
