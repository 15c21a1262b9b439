"""`musat as11 compare-soundings`: the bottom of St. Thomas beside soundings, and what these can have wrong."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyproj
import pytest
from click.testing import CliRunner, Result

import stage_readings
from json_schema import violations
from musatpy.cli.main import main as musat
from musatpy.compilation.compiled import compiled
from musatpy.compilation.joined_surfaces import surfaces_of
from musatpy.compilation.run_records import of_record
from musatpy.formats.compilation_deck import read_compilation
from musatpy.interchange import las
from musatpy.interchange.layers import Points
from musatpy.reports.soundings import schema
from record_rows import read_rows, with_columns


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the record of the run of St. Thomas."""
    folder = tmp_path_factory.mktemp("run")
    deck = stage_readings.FIXTURES / "st_thomas/st_thomas.crd"
    assert CliRunner().invoke(musat, ["run", str(deck), "-q", "-o", str(folder)]).exit_code == 0
    return folder / "st_thomas.json"


def compared(run: Path, folder: Path, text: str, *options: str) -> Result:
    file = folder / "s.csv"
    file.write_text(text)
    return CliRunner().invoke(
        musat, ["as11", "compare-soundings", str(run), str(stage_readings.DECK), str(file), *options]
    )


def scaled(factor: float, shift: float = 0.0) -> str:
    """Return the soundings with other depths."""
    head, *lines = stage_readings.soundings().splitlines()
    rows = [line.split(",") for line in lines]
    return "\n".join(
        [head, *(",".join([*row[:3], f"{float(row[3]) * factor + shift:.3f}", row[4]]) for row in rows)]
    )


def test_the_soundings_of_the_fixture_are_what_its_generator_writes() -> None:
    assert stage_readings.SOUNDINGS.read_text() == stage_readings.soundings()


def test_soundings_of_the_bottom(run: Path, tmp_path: Path) -> None:
    """No refraction is left (b), the datum is right (a); the scatter is that of bottom and points, .4 m."""
    result = compared(run, tmp_path, stage_readings.soundings(), "--plan-sigma", "1")
    assert result.exit_code == 0 and "of 200 soundings, median" in result.output
    record, of_record = read_rows(tmp_path / "s.soundings.json"), schema()
    assert not list(violations(with_columns(record, of_record), of_record, of_record))
    line = record["regression"]
    assert abs(line["b"]) < 3.0 * line["b_sigma"] and line["b_sigma"] < 0.01 and abs(line["a"]) < 0.25
    good = record["samples"][1]
    assert abs(good["median"]) < 0.2 and 0.2 < good["rms"] < 0.6
    blunders = {row["sounding"] for row in record["differences"] if row["blunder"]}
    assert {"S020", "S090", "S150"} - {row["sounding"] for row in record["left_out"]} <= blunders
    assert len(record["differences"]) + len(record["left_out"]) == 200
    assert sum(record["point_orders"].values()) == 241  # submerged points of the deck
    listing = (tmp_path / "s.soundings.lst").read_text()
    assert "edition 6.1.0" in listing and max(map(len, listing.splitlines())) <= 132


def test_the_water_over_the_points_of_a_bottom(run: Path) -> None:
    """It stands as far above them as they are deep below it."""
    result = compiled(of_record(run), read_compilation(stage_readings.DECK)[0])
    depth = result.gathered("depth")
    for surface in surfaces_of(result)[0]:
        points = surface.points
        below = points.depth - points.water
        assert len(below) > 60
        of_points = depth[np.isfinite(depth)]
        assert np.abs(below[:, None] - of_points).min(axis=1).max() < 1e-6  # m, of the mean of two tides


@pytest.mark.slow
def test_the_picture_is_the_same_from_run_to_run(run: Path, tmp_path: Path) -> None:
    pictures = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        assert compared(run, tmp_path, stage_readings.soundings(), "--plots", "-o", str(folder)).exit_code == 0
        pictures.append((folder / "s.soundings.png").read_bytes())
    assert pictures[0].startswith(b"\x89PNG") and pictures[0] == pictures[1]


def test_planes_about_soundings_agree_with_triangles(run: Path, tmp_path: Path) -> None:
    """To the scatter of the points; soundings without points within the radius say so, and the record says how."""
    assert compared(run, tmp_path, stage_readings.soundings(), "--radius", "200").exit_code == 0
    record, of_record = read_rows(tmp_path / "s.soundings.json"), schema()
    assert not list(violations(with_columns(record, of_record), of_record, of_record))
    assert record["matching"]["radius"] == 200.0 and "within 200 m" in (tmp_path / "s.soundings.lst").read_text()
    assert abs(record["samples"][1]["median"]) < 0.3 and record["samples"][1]["rms"] < 0.6
    assert abs(record["regression"]["b"]) < 0.02
    assert "too few points within the radius, or to one side" in {row["reason"] for row in record["left_out"]}


def test_old_soundings_are_left_out(run: Path, tmp_path: Path) -> None:
    head, *lines = stage_readings.soundings().splitlines()
    dates = ["1975-06-01", "1980-01-01", ""] * len(lines)
    text = "\n".join([f"{head},date", *(f"{line},{date}" for line, date in zip(lines, dates, strict=False))])
    assert compared(run, tmp_path, text, "--not-before", "1980-01-01").exit_code == 0
    record = read_rows(tmp_path / "s.soundings.json")
    reasons = [row["reason"] for row in record["left_out"]]
    assert reasons.count("older than 1980-01-01") == 67 and reasons.count("its date is not known") == 66
    assert {int(row["sounding"][1:]) % 3 for row in record["differences"]} == {1}
    result = compared(run, tmp_path, stage_readings.soundings(), "--not-before", "1980-01-01")
    assert result.exit_code == 1 and "no column date" in result.output


def test_a_las_file_on_a_map_says_what_the_csv_file_says(run: Path, tmp_path: Path) -> None:
    """NAD27, whose ellipsoid is that of the job; heights in place of depths."""
    rows = [line.split(",") for line in stage_readings.soundings().splitlines()[1:]]
    lat, lon, depth = np.array([[float(cell) for cell in row[1:4]] for row in rows]).T
    zone = pyproj.CRS("EPSG:26720")
    east, north = pyproj.Transformer.from_crs(zone.geodetic_crs, zone, always_xy=True).transform(lon, lat)
    cloud = tmp_path / "cloud.las"
    las.write(cloud, Points(xyz=np.column_stack([east, north, -depth]), crs=zone))
    command = ["as11", "compare-soundings", str(run), str(stage_readings.DECK), str(cloud), "--sigma", "0.1"]
    assert CliRunner().invoke(musat, command).exit_code == 0
    compared(run, tmp_path, stage_readings.soundings())
    of_las, of_csv = (read_rows(tmp_path / f"{name}.soundings.json") for name in ("cloud", "s"))
    pairs = list(zip(of_las["differences"], of_csv["differences"], strict=True))
    for of_point, of_line in pairs:
        assert of_point["difference"] == pytest.approx(of_line["difference"], abs=1e-3)  # 0.1 mm on steep slopes
        assert of_point["sigma"] == pytest.approx(of_line["sigma"], abs=1e-3)
    assert len(of_las["left_out"]) == len(of_csv["left_out"]) and len(pairs) == 175


def test_a_datum_shows_in_a_and_an_option_takes_it_away(run: Path, tmp_path: Path) -> None:
    compared(run, tmp_path, scaled(1.0, -0.5))
    shifted = read_rows(tmp_path / "s.soundings.json")["regression"]["a"]
    compared(run, tmp_path, scaled(1.0, -0.5), "--datum", "0.5")
    right = read_rows(tmp_path / "s.soundings.json")["regression"]["a"]
    assert shifted - right == pytest.approx(0.5, abs=0.01)  # and b times the shift


def test_soundings_in_feet_are_named(run: Path, tmp_path: Path) -> None:
    result = compared(run, tmp_path, scaled(3.2808))
    assert result.exit_code == 0 and "they look like feet" in result.output
    assert "they look like feet" in (tmp_path / "s.soundings.lst").read_text()


def test_soundings_in_centimetres_are_named(run: Path, tmp_path: Path) -> None:
    result = compared(run, tmp_path, scaled(100.0))
    assert result.exit_code == 0 and "they look like centimetres: divide them by 100" in result.output


@pytest.mark.parametrize(("shift", "words", "datum"), [(2.5, "deeper", -2.5), (-2.5, "less deep", 2.5)])
def test_a_constant_offset_is_named_with_the_datum_that_takes_it_away(
    run: Path, tmp_path: Path, shift: float, words: str, datum: float
) -> None:
    result = compared(run, tmp_path, scaled(1.0, shift))
    told = re.search(rf"all soundings are (\S+) m {words} than the bottom.* add (\S+) to --datum", result.output)
    assert result.exit_code == 0 and told and float(told[1]) == pytest.approx(2.5, abs=0.2)
    assert float(told[2]) == pytest.approx(datum, abs=0.2)
    right = compared(run, tmp_path, scaled(1.0, shift), "--datum", told[2])
    assert right.exit_code == 0 and "than the bottom" not in right.output


def west_positive() -> str:
    """Return the soundings with longitudes that are positive to the west."""
    return stage_readings.soundings().replace(",-64.", ",64.")


def exchanged() -> str:
    """Return the soundings with latitudes for longitudes."""
    return stage_readings.soundings().replace("name,lat,lon", "name,lon,lat", 1)


def test_soundings_that_are_there_twice_are_told(run: Path, tmp_path: Path) -> None:
    lines = stage_readings.soundings().splitlines(keepends=True)
    result = compared(run, tmp_path, "".join([*lines, lines[5], lines[7]]))
    name = lines[5].partition(",")[0]
    assert result.exit_code == 0 and f"2 soundings are there already, {name} first" in result.output


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("x,y,depth\n1,2,3\n", (), "give the soundings in these, or name the system of x and y (--crs"),
        (exchanged(), (), "of them would with lat and lon exchanged"),
        (
            west_positive(),
            (),
            "with the other sign of lon: they look like longitudes that are positive to the west",
        ),
        (
            west_positive().replace("lat,lon", "lon,lat"),
            (),
            "lat and lon exchanged, and the other sign of lon: they",
        ),
        ("lat,lon,depth\n10,20,3\n", (), "no sounding meets the bottom: outside the surface"),
        (stage_readings.soundings(), ("--steepest", "0"), "the bottom is steeper there than the limit"),
    ],
)
def test_soundings_that_meet_nothing(
    run: Path, tmp_path: Path, text: str, options: tuple[str, ...], message: str
) -> None:
    result = compared(run, tmp_path, text, *options)
    assert result.exit_code == 1 and message in " ".join(result.output.split())
    assert not (tmp_path / "s.soundings.lst").exists()


def test_a_datum_far_from_the_water_is_told(run: Path, tmp_path: Path) -> None:
    """Depths below an ellipsoid 36 m off look like soundings, and are none."""
    far = compared(run, tmp_path, scaled(1.0, 36.0), "--datum", "-36.0")
    assert far.exit_code == 0, far.output
    assert "the sounding datum is 35.6 m above the water, more than 20 m" in far.stderr
    near = compared(run, tmp_path, scaled(1.0, 2.0), "--datum", "-2.0")
    assert "the sounding datum is" not in near.stderr
