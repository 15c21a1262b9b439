"""Points of the lagoon corrected: against the truth, in every format, and files that cannot be used."""

import datetime
import uuid
from pathlib import Path
from typing import Any

import laspy
import numpy as np
import pytest

from depth import lagoon
from depth.lagoon import rows
from musatpy.depth.cameras import CameraStations, read_cameras
from musatpy.depth.correction import Correction
from musatpy.depth.csv_points import ADDED, correct_csv
from musatpy.depth.las_points import correct_las
from musatpy.errors import DepthError, InterchangeError
from musatpy.pointfiles.las_files import point_count
from musatpy.pointfiles.point_tables import CHUNK
from musatpy.refraction.apparent import Stations

FOLDER = lagoon.FOLDER
CAMERA = (lagoon.FOCAL, lagoon.FORMAT, lagoon.FORMAT)
# Apparent coordinates end at 0.1 mm. Half of that is 0.08 mm of depth by F < 1.6; where a point has left the place
# where its rays meet, its true point leaves it along them by some times as much
NEAR = 5.0e-4


def correction() -> Correction:
    return Correction(cameras=read_cameras(FOLDER / "cameras.csv", camera=CAMERA), index=lagoon.INDEX)


@pytest.fixture(scope="module")
def corrected(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, str]]:
    target = tmp_path_factory.mktemp("lagoon") / "true.csv"
    correct_csv(FOLDER / "points.csv", target, correction())
    return rows(target)


def test_the_fixture_is_what_its_script_makes() -> None:
    for name, text in lagoon.files().items():
        assert (FOLDER / name).read_text() == text


def test_true_points_are_the_truth(corrected: list[dict[str, str]]) -> None:
    truth = {row["point"]: row for row in rows(FOLDER / "truth.csv")}
    good = [row for row in corrected if not row["reason"]]
    assert len(good) > 60
    for row in good:
        for axis in "xyz":
            assert float(row[f"true_{axis}"]) == pytest.approx(float(truth[row["point"]][axis]), abs=NEAR)
    for row in corrected:
        assert row["cameras"] == truth[row["point"]]["photos"]


def test_every_point_has_numbers_or_a_reason(corrected: list[dict[str, str]]) -> None:
    reasons = {}
    for row in corrected:
        numbers = [row[name] for name in ADDED if name not in ("cameras", "reason")]
        if row["reason"]:
            assert set(numbers) == {""}
            reasons[row["point"]] = row["reason"]
        else:
            assert all(np.isfinite(float(number)) for number in numbers)
    assert reasons["ROCK"] == "not below the water"
    assert reasons["AWASH"] == "between the tides of its cameras"
    assert reasons["OFF"] == "no camera sees it"
    others = {reason for name, reason in reasons.items() if name not in ("ROCK", "AWASH", "OFF")}
    assert others == {"only one camera sees it"}


def test_depth_factor_and_tally(tmp_path: Path, corrected: list[dict[str, str]]) -> None:
    tally = correct_csv(FOLDER / "points.csv", tmp_path / "true.csv", correction())
    good = [row for row in corrected if not row["reason"]]
    assert tally.faults.tolist()[0] == len(good) and tally.faults.sum() == len(corrected)
    assert tally.deepest == pytest.approx(max(float(row["depth"]) for row in good), abs=1e-4)
    assert tally.largest_spread == pytest.approx(max(float(row["spread"]) for row in good), abs=1e-4)
    mean = np.mean([float(row["factor"]) for row in good])
    assert tally.factor_sum / len(good) == pytest.approx(mean, abs=1e-5)
    tides = {row["name"]: float(row["tide"]) for row in rows(FOLDER / "cameras.csv")}
    for row in good:
        level = np.mean([tides[name] for name in row["cameras"].split()])
        depth, apparent = float(row["depth"]), level - float(row["z"])
        assert depth == pytest.approx(level - float(row["true_z"]), abs=2e-4)
        assert depth / apparent == pytest.approx(float(row["factor"]), abs=1e-4)


def many(tmp_path: Path, count: int) -> Path:
    """A file of points of several chunks, with other columns, a quoted text and blank lines."""
    rng = np.random.default_rng(5)
    path = tmp_path / "many.csv"
    with path.open("w", newline="") as file:
        file.write("Z,text,X,Y\n")
        for i, (x, y, z) in enumerate(rng.uniform((0, 0, -15), (1500, 900, 1), (count, 3)).round(3).tolist()):
            file.write(f'{z},"no. {i}, é",{x},{y}\n' + ("\n" if i % 9999 == 0 else ""))
    return path


@pytest.mark.slow
def test_processes_and_chunks_make_the_same_file(tmp_path: Path) -> None:
    source = many(tmp_path, 2 * CHUNK + 100)
    steps: list[int] = []
    one = correct_csv(source, tmp_path / "one.csv", correction(), progress=steps.append)
    two = correct_csv(source, tmp_path / "two.csv", correction(), jobs=2)
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "two.csv").read_bytes()
    assert one.faults.tolist() == two.faults.tolist() and one.faults.sum() == 2 * CHUNK + 100
    assert len(steps) == 3 and sum(steps) == source.stat().st_size
    given, out = rows(source), rows(tmp_path / "one.csv")
    assert [row["text"] for row in out] == [row["text"] for row in given]


def test_nothing_is_left_of_a_file_with_a_line_that_cannot_be_read(tmp_path: Path) -> None:
    source = tmp_path / "points.csv"
    source.write_text("x,y,z\n1,2,-3\n\n1,two,-3\n")
    with pytest.raises(DepthError, match=r":4 cols 3-5 y: 'two' is not a number"):
        correct_csv(source, tmp_path / "out.csv", correction())
    assert not list(tmp_path.glob("*out.csv*"))  # not even half a file


def test_a_coordinate_that_is_no_number_is_a_reason(tmp_path: Path) -> None:
    source = tmp_path / "points.csv"
    source.write_text("x,y,z\n500,400,nan\n500,400,-3\n500,400,\n , ,\n500,inf,-3\n")
    correct_csv(source, tmp_path / "out.csv", correction())
    why = "a coordinate is no number"
    assert [row["reason"] for row in rows(tmp_path / "out.csv")] == [why, "", why, why]


def test_points_that_no_camera_sees_are_an_error_together(tmp_path: Path) -> None:
    """One that is off has a reason; where all are, they are in another system."""
    source, out = tmp_path / "points.csv", tmp_path / "out.csv"
    source.write_text("x,y,z\n9000,300,-3\n9100,300,5\nnan,,\n")
    with pytest.raises(DepthError) as caught:
        correct_csv(source, out, correction())
    message = caught.value.problems[0].message
    assert message.startswith(
        "no camera sees any of its 2 points: are they in the system of the job? They were taken"
    )
    assert "as local rectangular. The middle of the stations is X 806.8452, Y 449.5122, Z 899" in message
    assert not list(tmp_path.glob("*out.csv*"))
    source.write_text("x,y,z\n9000,300,-3\n700,300,-4\n")
    assert correct_csv(source, out, correction()).seen == 1


def test_a_file_without_points_has_a_line_of_names(tmp_path: Path) -> None:
    source = tmp_path / "points.csv"
    source.write_text("x,y,z")
    assert correct_csv(source, tmp_path / "out.csv", correction()).lines() == ["0 points, 0 corrected"]
    assert (tmp_path / "out.csv").read_text() == ",".join(["x,y,z", *ADDED]) + "\n"


def test_las_has_the_same_points(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("musatpy.pointfiles.las_files.CHUNK", 50)
    given = rows(FOLDER / "points.csv")
    assert len(given) > 50  # more than a chunk
    xyz = np.array([[float(row[axis]) for axis in "xyz"] for row in given])
    header = laspy.LasHeader(version="1.4", point_format=6)
    header.scales, header.offsets = np.full(3, 1e-4), np.zeros(3)
    header.add_extra_dim(laspy.ExtraBytesParams(name="quality", type="f4"))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.intensity = np.arange(len(xyz))
    las.quality = np.arange(len(xyz)) / 7.0
    las.write(tmp_path / "in.laz")
    assert point_count(tmp_path / "in.laz") == len(xyz)
    tallies = [correct_las(tmp_path / "in.laz", tmp_path / f"{n}.las", correction(), jobs=n) for n in (1, 2)]
    assert tallies[0].faults.tolist() == tallies[1].faults.tolist()
    found, again = (laspy.read(tmp_path / f"{n}.las") for n in (1, 2))
    assert (found.points.array == again.points.array)[np.asarray(found.reason) == 0].all()
    points, seen = correction()(xyz)
    good = points.fault == 0
    np.testing.assert_array_equal(found.reason, points.fault)
    # half a unit of the scale, and half of that of the points given
    np.testing.assert_allclose(np.asarray(found.xyz)[good], points.position[good], atol=2e-4)
    np.testing.assert_allclose(np.asarray(found.xyz)[~good], xyz[~good], atol=1e-4)
    np.testing.assert_allclose(found.apparent_z, xyz[:, 2], atol=1e-4)
    np.testing.assert_allclose(np.asarray(found.depth)[good], points.depth[good], rtol=1e-4)
    np.testing.assert_array_equal(found.cameras, points.cameras)
    bits = np.asarray(found.camera_bits_0)
    for camera in range(8):
        np.testing.assert_array_equal((bits >> np.uint64(camera)) & np.uint64(1) == 1, seen[:, camera])
    np.testing.assert_array_equal(found.intensity, np.asarray(las.intensity))
    np.testing.assert_array_equal(found.quality, np.asarray(las.quality))
    with pytest.raises(InterchangeError, match="there is a dimension"):
        correct_las(tmp_path / "1.las", tmp_path / "3.las", correction())


def test_las_has_a_bit_for_each_of_many_cameras(tmp_path: Path) -> None:
    position = np.column_stack([np.linspace(0.0, 6900.0, 70), np.zeros(70), np.full(70, 900.0)])
    stations = Stations(position=position, level=np.zeros(70))
    cameras = CameraStations(names=tuple(map(str, range(70))), stations=stations, limit=np.radians(30.0))
    header = laspy.LasHeader(version="1.2", point_format=0)
    header.scales = np.full(3, 1e-3)
    las = laspy.LasData(header)
    las.x, las.y, las.z = np.array([[100.0, 0.0, -5.0], [6350.0, 30.0, -4.0], [6800.0, 0.0, -3.0]]).T
    las.write(tmp_path / "in.las")
    correct_las(tmp_path / "in.las", tmp_path / "out.las", Correction(cameras=cameras, index=1.34))
    found = laspy.read(tmp_path / "out.las")
    seen = cameras.sees(np.asarray(las.xyz))
    words = [np.asarray(found[f"camera_bits_{word}"]) for word in (0, 1)]
    bits = [[int(words[i // 64][row]) >> (i % 64) & 1 for i in range(70)] for row in range(3)]
    np.testing.assert_array_equal(bits, seen)
    assert seen[1, 60:66].any() and seen[2, 64:].any()


def test_a_file_that_is_no_las(tmp_path: Path) -> None:
    (tmp_path / "no.las").write_text("x,y,z\n")
    with pytest.raises(InterchangeError, match="is no LAS file"):
        point_count(tmp_path / "no.las")


# --- cameras ---


def test_a_camera_sees_its_format_and_its_angle() -> None:
    """The images of the truth decide, not the formula that is tested."""
    cameras = correction().cameras
    points = np.array([[float(row[axis]) for axis in "xyz"] for row in rows(FOLDER / "points.csv")])
    images = np.array([[lagoon.straight(camera, point) for _, camera in lagoon.stations()] for point in points])
    ahead = np.array([[point[2] < camera[2] for _, camera in lagoon.stations()] for point in points])
    inside = ahead & (np.abs(images).max(axis=2) <= lagoon.FORMAT / 2.0)
    np.testing.assert_array_equal(cameras.sees(points), inside)
    gap = points[:, None] - cameras.stations.position
    off = np.degrees(np.arctan2(np.hypot(gap[..., 0], gap[..., 1]), -gap[..., 2]))
    limited = CameraStations(names=cameras.names, stations=cameras.stations, limit=np.radians(25.0))
    np.testing.assert_array_equal(limited.sees(points), off <= 25.0)


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("name,x,y,z\n1,0,0,900\n", 1, "no column tide, and no water level is given"),
        ("name,x,y,z,tide,omega\n", 1, "omega, phi, kappa go together: only omega found"),
        ("name,x,y,z,tide,roll\n", 1, "unknown column roll"),
        ("name,x,y,height,tide\n", 1, "no column z [m] among name, x, y, height"),  # that of the format
        ("name,x,y,z,tide\n", None, "no station"),
        ("name,x,y,z,tide\n1,0,0,900,901\n", 2, "the water at 901 m is not below the station"),
        ("name,x,y,z,tide\na b,0,0,900,0\n", 2, "a name without blanks"),
        (
            "name,x,y,z,tide,focal,width,height\n1,0,0,900,0,0,230,230\n",
            2,
            "focal: '0' is not a number gr",
        ),
        ("name,x,y,z,tide,focal,width,height\n1,0,0,900,0,152,230,230\n", None, "a format needs attitudes"),
    ],
)
def test_a_file_of_cameras_that_cannot_be_used(tmp_path: Path, text: str, line: int | None, message: str) -> None:
    path = tmp_path / "cameras.csv"
    path.write_text(text)
    with pytest.raises(DepthError) as caught:
        read_cameras(path)
    problem = caught.value.problems[0]
    assert (problem.file, problem.line) == (str(path), line)
    assert message in problem.headline()


def test_what_the_file_has_is_not_given_twice(tmp_path: Path) -> None:
    path = tmp_path / "cameras.csv"
    path.write_text("name,x,y,z,tide,omega,phi,kappa,focal,width,height\n1,0,0,900,0,0,0,0,152,230,230\n")
    with pytest.raises(DepthError) as caught:
        read_cameras(path, level=0.0, camera=CAMERA)
    level, camera = [problem.message for problem in caught.value.problems]
    assert level == "there is a column tide, and a water level is given too: one or the other"
    assert camera == "there is a column focal, and a camera is given too: one or the other"


def test_a_level_that_is_given_is_not_above_a_station(tmp_path: Path) -> None:
    path = tmp_path / "cameras.csv"
    path.write_text("name,x,y,z\n1,0,0,900\n2,0,0,80\n")
    assert read_cameras(path, level=1.5).stations.level.tolist() == [1.5, 1.5]
    with pytest.raises(DepthError, match="station 2 is not above the water"):
        read_cameras(path, level=100.0)


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
    correct_las(tmp_path / f"in.{kind}", tmp_path / f"out.{kind}", correction())
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
    for data in (b"", b"LASF" + bytes(300), whole[:100], whole[: len(whole) // 2], whole[:600] + b"\xff" * 3000):
        source.write_bytes(data)
        with pytest.raises(InterchangeError) as caught:
            correct_las(source, tmp_path / f"out.{kind}", correction())
        assert caught.value.problems[0].file == str(source)
        assert not list(tmp_path.glob("*out.*"))


def spoilt(path: Path, place: int, data: bytes) -> Path:
    content = bytearray(path.read_bytes())
    content[place : place + len(data)] = data
    path.write_bytes(content)
    return path


def test_names_of_the_header_are_kept_as_they_are(tmp_path: Path) -> None:
    """Latin-1 too, of which the specification knows nothing; names of dimensions are ASCII or UTF-8."""
    given(tmp_path / "in.las", "1.4", 6)
    correct_las(spoilt(tmp_path / "in.las", 26, b"B\xfcro"), tmp_path / "out.las", correction())
    assert (tmp_path / "out.las").read_bytes()[26:30] == b"B\xfcro"
    amplitude = (tmp_path / "in.las").read_bytes().index(b"amplitude")
    with pytest.raises(InterchangeError, match="is no LAS file: 'utf-8' codec can't decode"):
        correct_las(spoilt(tmp_path / "in.las", amplitude, b"h\xf6he"), tmp_path / "2.las", correction())


@pytest.mark.parametrize(
    ("place", "data", "message"),
    [
        (94, b"\xff\xff", "records before its points would not fit"),
        (96, b"\xff\xff\xff\x7f", "its header would not fit"),
        (100, b"\xff\xff\xff\xff", "records before its points would not fit"),
        (247, b"\xff\xff\xff\xff\xff\xff", "points of .* bytes would not fit"),
        (243, b"\xff\xff\xff\xff", "records behind its points would not fit"),
        (235, b"\xff\xff\xff\xff\xff\xff", "records behind its points would not fit"),
        (375 + 20, b"\xff\xff", "records before its points would not fit"),
        (131, b"\0\0\0\0\0\0\xf0\x7f", "scales or offsets are no numbers"),
    ],
)
def test_what_a_header_counts_must_fit_into_the_file(tmp_path: Path, place: int, data: bytes, message: str) -> None:
    given(tmp_path / "in.las", "1.4", 6)
    with pytest.raises(InterchangeError, match=message):
        correct_las(spoilt(tmp_path / "in.las", place, data), tmp_path / "out.las", correction())
    assert not (tmp_path / "out.las").exists()
