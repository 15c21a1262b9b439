"""What a LAS file keeps when its points are corrected, and files that are none."""

from __future__ import annotations

import datetime
import io
import uuid
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from depth.test_lagoon import correction
from musatpy.depth.las_points import correct_las
from musatpy.errors import DepthError
from musatpy.pointfiles.las_headers import checked_head

laspy = pytest.importorskip("laspy")

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
        with pytest.raises(DepthError) as caught:
            correct_las(source, tmp_path / f"out.{kind}", correction())
        assert caught.value.problems[0].file == str(source)
        assert not list(tmp_path.glob("*out.*"))


def spoilt(path: Path, place: int, data: bytes) -> Path:
    content = bytearray(path.read_bytes())
    content[place : place + len(data)] = data
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("kind", ["las", "laz"])
def test_names_in_latin_1_are_kept(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"in.{kind}"
    given(path, "1.4", 6)
    header = laspy.open(path).header
    assert header.vlrs
    content = path.read_bytes()
    spoilt(path, 26, b"B\xfcro")  # system identifier
    spoilt(path, content.index(b"someone\0"), b"H\xf6he nn")  # user of a record
    spoilt(path, content.index(b"amplitude"), b"h\xf6he\0\0\0\0\0")  # an extra dimension
    correct_las(path, tmp_path / f"out.{kind}", correction())
    out = (tmp_path / f"out.{kind}").read_bytes()
    assert out[26:30] == b"B\xfcro" and b"H\xf6he nn" in out
    assert "höhe" in laspy.read(io_headed(tmp_path / f"out.{kind}")).point_format.dimension_names


def io_headed(path: Path) -> io.BytesIO:
    with path.open("rb") as file:
        head = checked_head(file)
    return io.BytesIO(head + path.read_bytes()[len(head) :])


@pytest.mark.parametrize(
    ("place", "data", "message"),
    [
        (94, b"\xff\xff", "its header would not fit"),
        (96, b"\xff\xff\xff\x7f", "its header would not fit"),
        (100, b"\xff\xff\xff\xff", "records before its points would not fit"),
        (247, b"\xff\xff\xff\xff\xff\xff", "points of .* bytes would not fit"),
        (243, b"\xff\xff\xff\xff", "records behind its points would not fit"),
        (235, b"\xff\xff\xff\xff\xff\xff", "a record behind its points would not fit"),
        (375 + 20, b"\xff\xff", "a record before its points would not fit"),
        (131, b"\0\0\0\0\0\0\xf0\x7f", "scales or offsets are no numbers"),
    ],
)
def test_what_a_header_counts_must_fit_into_the_file(tmp_path: Path, place: int, data: bytes, message: str) -> None:
    given(tmp_path / "in.las", "1.4", 6)
    with pytest.raises(DepthError, match=message):
        correct_las(spoilt(tmp_path / "in.las", place, data), tmp_path / "out.las", correction())
    assert not (tmp_path / "out.las").exists()
