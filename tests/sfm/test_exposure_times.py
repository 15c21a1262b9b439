"""Times and positions of exposures by a CSV of exiftool: what speaks first, clocks, names, and every fault."""

from pathlib import Path

import numpy as np
import pytest

from musatpy.pointfiles.gauges import parsed_time, zone_of
from musatpy.sfm.model import ModelError
from musatpy.sfm.times import SOURCES, Exposures, clock_offset, matched, read_exposures

NOON = 1715947200.0  # 2024-05-17 12:00 UTC
HEAD = (
    "SourceFile,UTCAtExposure,GPSDateStamp,GPSTimeStamp,DateTimeOriginal,SubSecTimeOriginal,OffsetTimeOriginal,"
    "GPSLatitude,GPSLatitudeRef,GPSLongitude,GPSLongitudeRef,AbsoluteAltitude,RtkFlag,RtkStdLon,RtkStdLat,RtkStdHgt"
)


def exposures(
    tmp_path: Path, rows: list[str], head: str = HEAD, zone: str = "", heights: bool = False
) -> Exposures:
    """Return what a CSV of rows says; they may end early."""
    full = [row + "," * (head.count(",") - row.count(",")) for row in rows]
    (tmp_path / "exif.csv").write_text("\n".join([head, *full]) + "\n")
    return read_exposures(tmp_path / "exif.csv", zone, heights=heights)


def faults(tmp_path: Path, rows: list[str], head: str = HEAD, zone: str = "") -> list[str]:
    """Return what is wrong with a CSV."""
    with pytest.raises(ModelError) as caught:
        exposures(tmp_path, rows, head, zone)
    return [problem.headline().rpartition("/exif.csv")[2] for problem in caught.value.problems]


def test_the_first_that_speaks_says_the_time(tmp_path: Path) -> None:
    read = exposures(
        tmp_path,
        [
            "a.jpg,2024-05-17T12:00:00.25,2024:05:17,11:00:00,2024:05:17 10:00:00,,+00:00",
            "b.jpg,,2024:05:17,12:00:00.5,2024:05:17 10:00:00,,+00:00",
            "c.jpg,,,,2024:05:17 14:30:00,07,+02:30",
            "d.jpg,,,,2024:05:17 14:00:00.75-01:00,12,",
            "e.jpg,,0000:00:00,00:00:00,2024:05:17 14:00:01,50,",
            "f.jpg,,2024:05:17,,,,",
        ],
        zone="Europe/Berlin",
    )
    expected = [0.25, 0.5, 0.07, 10800.75, 1.5, np.nan]
    np.testing.assert_allclose(read.time - NOON, expected, atol=1e-6)
    assert [SOURCES[source] for source in read.source] == [*SOURCES[1:4], SOURCES[3], SOURCES[4], SOURCES[0]]
    np.testing.assert_allclose(exposures(tmp_path, ["e.jpg,,,,2024:05:17 14:00:01"]).time, [np.nan])
    later = exposures(tmp_path, ["e.jpg,,,,2024:05:17 14:00:01"], zone="-03:30")
    np.testing.assert_allclose(later.time - NOON, [7201.0 + 12600.0])


def test_names_of_tags_have_their_groups_and_the_signed_one_goes_first(tmp_path: Path) -> None:
    head = (
        "SourceFile,EXIF:GPSLatitude,XMP-drone-dji:GPSLatitude,XMP-drone-dji:GPSLongtitude,EXIF:GPSAltitude,"
        "EXIF:GPSAltitudeRef,ExifIFD:DateTimeOriginal,ExifIFD:OffsetTimeOriginal"
    )
    row = "a.jpg,33.9,-33.91234567,18.4,5.5,1,2024:05:17 12:00:00,Z"
    read = exposures(tmp_path, [row], head, heights=True)
    np.testing.assert_allclose(np.degrees(read.position[0, :2]), [-33.91234567, 18.4], atol=1e-12)
    assert read.position[0, 2] == -5.5 and read.time[0] == NOON
    bare = "SourceFile,EXIF:GPSLatitude,EXIF:GPSLongitude"
    assert faults(tmp_path, ["a.jpg,33,18"], bare) == [
        f":1: column exif:{name.lower()} has no sign: a column {name.lower()}ref is missing"
        for name in ("GPSLatitude", "GPSLongitude")
    ]


def test_sigmas_are_those_of_rtk_where_it_was_fixed(tmp_path: Path) -> None:
    rows = [
        "a.jpg,,,,,,,33.5,S,18.25,W,40.5,50,.011,.012,.03",
        "b.jpg,,,,,,,33.5,S,18.25,W,40.5,16,.9,.8,.7",
        "c.jpg,,,,,,,33.5,S,18.25,W,40.5,50,,,",
        "d.jpg,,,,,,,0,,0,,40.5,50,.01,.01,.01",
        "f.jpg,,,,,,,33.5,S,,,40.5,50,.01,.01,.01",
        "e.jpg",
    ]
    read = exposures(tmp_path, rows)
    np.testing.assert_allclose(read.position[0], [np.radians(-33.5), np.radians(-18.25), 40.5])
    nan = np.nan
    expected = [
        [0.011, 0.012, 0.03],
        [5.0, 5.0, nan],
        [5.0, 5.0, nan],
        [nan, nan, 0.01],
        [nan, nan, 0.01],
        [nan, nan, nan],
    ]
    np.testing.assert_array_equal(read.sigma, expected)
    assert read.rtk.tolist() == [True, False, False, True, True, False]
    np.testing.assert_array_equal(exposures(tmp_path, rows, heights=True).sigma[:3, 2], [0.03, 10.0, 10.0])


def clocks(tmp_path: Path, show: np.ndarray, offset: str = "") -> Exposures:
    """Return exposures every 4 s from noon on, whose clock shows seconds after noon."""
    rows = []
    for number, shown in enumerate(show):
        time = np.datetime64("2024-05-17T12:00:00") + np.timedelta64(round(1e3 * shown), "ms")
        day, _, hour = str(time).replace("-", ":").partition("T")
        gps = f"2024:05:17,12:{number * 4 // 60:02d}:{number * 4 % 60:02d}"
        rows.append(f"{number:03d}.jpg,,{gps},{day} {hour[:8]},{hour[9:]},{offset}")
    return exposures(tmp_path, rows)


def test_the_clock_is_compared_with_gps_time(tmp_path: Path) -> None:
    t = 4.0 * np.arange(300)
    true = 7200.0 + 12.5 + 30.0 / 86400.0 * (t - np.median(t))
    show = t + true + np.random.default_rng(3).normal(0.0, 0.002, 300)
    show[40:60] += 3600.0
    found = clock_offset(clocks(tmp_path, show))
    assert abs(found.offset - 7212.5) < 0.01 and abs(found.beside - 12.5) < 0.01
    assert abs(found.drift - 30.0) < 0.3 and found.photos == 300
    assert found.apart.tolist() == [f"{number:03d}.jpg" for number in range(40, 60)]
    slow, apart = found.warnings()
    assert slow.startswith("the camera's clock is +7212.5 s off GPS time, +12.5 s beside whole quarter hours")
    assert "on 20 photos: 040.jpg 041.jpg" in apart
    right = clock_offset(clocks(tmp_path, t + 7200.0 - 4.0, "+02:00"))
    assert abs(right.offset + 4.0) < 1e-6 and right.warnings() == []
    few = clock_offset(clocks(tmp_path, t[:2]))
    assert few.offset == 0.0 and np.isnan(few.drift) and np.isnan(few.scatter)
    none = clock_offset(exposures(tmp_path, ["a.jpg"]))
    assert none.photos == 0 and np.isnan(none.offset) and np.isnan(none.beside) and none.warnings() == []


def test_photos_are_matched_by_the_whole_path_else_by_the_only_tail() -> None:
    files = ["./nadir/101MEDIA/DJI_0001.JPG", "nadir/102MEDIA/DJI_0001.JPG", "oblique/DJI_0002.JPG", "DJI_0002.JPG"]
    names = [
        "nadir\\102media\\DJI_0001.jpg",  # whole
        "101MEDIA/DJI_0001.JPG",  # tail of the file
        "DJI_0001.JPG",  # of two
        "DJI_0002.JPG",  # whole goes before tail
        "/data/DJI_0002.JPG",  # the file is its tail
        "102MEDIA/DJI_0001",  # label without a suffix
        "other/DJI_0001.JPG",  # of another folder
        "I_0002.JPG",  # no tail of folders
    ]
    assert matched(names, files).tolist() == [1, 0, -2, 3, 3, 1, -1, -1]
    assert matched(["a.jpg", "a"], ["x/a.jpg", "x/a.dng"]).tolist() == [0, -2]
    assert matched(["m/a.jpg", "a.jpg", "b.dng", "c.v2"], ["m/a", "b.jpg", "c.v2"]).tolist() == [0, 0, -1, 2]


def test_exposures_of_the_photos_of_a_model(tmp_path: Path) -> None:
    read = exposures(tmp_path, [f"m/{number}.jpg,2024-05-17 12:00:0{number}" for number in range(4)])
    of = read.of(["3.jpg", "m/1.jpg"], "exif.csv")
    assert of.photos.tolist() == ["3.jpg", "m/1.jpg"] and (of.time - NOON).tolist() == [3.0, 1.0]
    assert of.sigma.shape == (2, 3)
    with pytest.raises(ModelError) as caught:
        read.of(["3.jpg", "m/3.jpg", "7.jpg"], "exif.csv")
    assert [problem.headline() for problem in caught.value.problems] == [
        "exif.csv: photos 3.jpg and m/3.jpg would both be m/3.jpg",
        "exif.csv: photo 7.jpg: no row fits",
    ]
    with pytest.raises(
        ModelError, match=r"exif.csv: it has none of the photos .* as x/7.jpg; its first is m/0.jpg"
    ):
        read.of(["x/7.jpg", "8.jpg"], "exif.csv")


def test_what_is_wrong_is_told_with_its_place(tmp_path: Path) -> None:
    assert faults(tmp_path, ["a"], "File,UTCAtExposure") == [":1: no column sourcefile among File, UTCAtExposure"]
    assert faults(tmp_path, []) == [": there are no photos"]
    assert faults(
        tmp_path,
        [
            "a.jpg,17.05.2024",
            "a.jpg,,2024:05:17,25:00:00",
            "c.jpg,,,,2024:02:30 10:00:00,,",
            "d.jpg,,,,2024:05:17 10:00:00,x,+2",
            "e.jpg,,,,,,,91,N",
            "f.jpg,,,,,,,-12,N",
        ],
    ) == [
        ":3 cols 1-5 sourcefile: 'a.jpg' stands in line 2 already",
        ":6 cols 13-14 gpslatitude: '91' is not a number from -90 to 90, as 'exiftool -n' prints it",
    ]
    assert faults(
        tmp_path,
        [
            "a.jpg,17.05.2024",
            "b.jpg,,2024:05:17,25:00:00",
            "c.jpg,,,,2024:02:30 10:00:00,,",
            "d.jpg,,,,2024:05:17 10:00:00,x,+2",
            "e.jpg,,,,,,,-12,N",
            "f.jpg,,,,1024:05:17 10:00:00,,",
            "g.jpg,,,,2024:10:27 02:30:00,,",
            "h.jpg,,,,2024:03:31 02:30:00,,",
        ],
        zone="Europe/Berlin",
    ) == [
        ":2 cols 7-16 utcatexposure: '17.05.2024' is no date and time YYYY:MM:DD hh:mm:ss",
        ":3 cols 19-26 gpstimestamp: '2024:05:17 25:00:00' is no date and time YYYY:MM:DD hh:mm:ss",
        ":4 cols 10-28 datetimeoriginal: '2024:02:30 10:00:00' is no date and time YYYY:MM:DD hh:mm:ss",
        ":5 cols 30-30 subsectimeoriginal: 'x' is no part of a second".replace("cols 30-30", "col 30"),
        ":5 cols 32-33 offsettimeoriginal: '+2' is no offset +hh:mm",
        ":6 cols 13-15 gpslatitude: -12 degrees stand beside 'N'",
        ":7 cols 10-28 datetimeoriginal: '1024:05:17 10:00:00' is no date and time YYYY:MM:DD hh:mm:ss",
        ":8 cols 10-28 datetimeoriginal: '2024:10:27 02:30:00' is of the hour at which clocks change in"
        " Europe/Berlin: give the offset +hh:mm",
        ":9 cols 10-28 datetimeoriginal: '2024:03:31 02:30:00' is of the hour at which clocks change in"
        " Europe/Berlin: give the offset +hh:mm",
    ]
    for zone in ("Europe/Nowhere", "+25:00", "../etc/passwd", "02:00"):
        with pytest.raises(ModelError, match="is no time zone"):
            zone_of(zone, ModelError)


@pytest.mark.parametrize(
    "text", ["2024:05:17 10:00:61", "2024:13:01 10:00:00", "٢٠٢٤:05:17 10:00:00", "2024:05:17", ""]
)
def test_what_is_no_time(text: str) -> None:
    assert parsed_time(text) is None
