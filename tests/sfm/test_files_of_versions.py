"""Files as versions of the programs write them, beside those of `written_models`: each is read as these are."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from musatpy.pointfiles.gauges import read_tide
from musatpy.sfm import colmap, metashape, opensfm
from musatpy.sfm.control import read_control
from musatpy.sfm.importing import Asked, imported
from musatpy.sfm.model import ModelError
from musatpy.sfm.times import read_exposures
from musatpy.sfm.wet import read_water
from sfm.test_control import gcp_list
from sfm.written_models import (
    HEIGHT,
    LATITUDE,
    LONGITUDE,
    Scene,
    scene,
    write_colmap,
    write_metashape,
    write_opensfm,
)

RESOLUTION = '<resolution width="4000" height="3000"/>'
LOCAL = 'LOCAL_CS["Local Coordinates (m)",LOCAL_DATUM["Local Datum",0],UNIT["metre",1]]'
ROLLING = '<property name="rolling_shutter" value="true"/>'


@pytest.fixture(scope="module")
def small() -> Scene:
    return scene(wide=2)


@pytest.fixture(scope="module")
def xml(tmp_path_factory: pytest.TempPathFactory, small: Scene) -> str:
    return write_metashape(tmp_path_factory.mktemp("xml") / "cameras.xml", small).read_text()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (RESOLUTION, ""),  # then that of the calibration counts
        ("<chunk ", "<chunks><chunk "),
        ("</components>", '<component id="1" label="left over"/></components>'),
        ('<cameras><camera id="0" sensor_id="0" component_id="0"', '<cameras><camera id="0" sensor_id="0"'),
    ],
)
def test_forms_of_metashape(tmp_path: Path, small: Scene, xml: str, old: str, new: str) -> None:
    text = xml.replace('class="adjusted">', f'class="adjusted">{RESOLUTION}').replace(old, new, 1)
    (tmp_path / "cameras.xml").write_text(
        text.replace("</document>", "</chunks></document>" * ("<chunks>" in text) or "</document>")
    )
    model = metashape.read_model(tmp_path / "cameras.xml")
    assert model.photos.tolist() == small.names and (model.lenses[0].width, model.lenses[0].height) == (4000, 3000)
    assert model.notes == () and model.to_geocentric is not None


def test_what_metashape_leaves_out_is_said(tmp_path: Path, small: Scene, xml: str) -> None:
    text = xml.replace('label="flight 1/DJI_0001.JPG"', 'label="flight 1/DJI_0001.JPG" enabled="false"')
    more = (
        '<camera id="90" sensor_id="0" master_id="0" label="a"/><camera id="91" sensor_id="0" label="b"/></cameras>'
    )
    text = text.replace("</cameras>", more).replace(RESOLUTION, RESOLUTION + ROLLING, 1)
    (tmp_path / "cameras.xml").write_text(text)
    model = metashape.read_model(tmp_path / "cameras.xml")
    assert model.photos.tolist() == [name for name in small.names if name != "flight 1/DJI_0001.JPG"]
    assert model.notes == (
        "1 of 8 photos are disabled: they are left out",
        "1 of 8 photos follow the master of a rig: they are left out",
        "1 of 8 photos are not aligned: they are left out",
        "sensor L has a rolling shutter: what it moves within a photo is not corrected",
    )


def test_local_coordinates_of_metashape_are_no_geocentric_ones(tmp_path: Path, xml: str) -> None:
    (tmp_path / "cameras.xml").write_text(xml.replace("<reference>EPSG:4326", f"<reference>{LOCAL}"))
    assert metashape.read_model(tmp_path / "cameras.xml").to_geocentric is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("</p2>", "</p2><p3>0.01</p3>", "sensor L has p3, which is not read: calibrate it without"),
        ("</p2>", "</p2><p4>x</p4>", "sensor L: "),
        (' y="18.3"', ' y="north"', r"camera flight 0/DJI_0000\.JPG: its reference is not three numbers"),
        (' label="flight 1/DJI_0001.JPG"', "", "the name of a photo, '', is not text of 1 to 128 letters"),
        ("</chunk>", '</chunk><chunk label="2"/>', "it has 2 chunks: an export of cameras has one"),
        ('type="frame"', 'type="spherical"', r"cameras\.xml: sensor 0 has no calibration as frame or fisheye$"),
    ],
)
def test_what_of_metashape_is_not_read(tmp_path: Path, xml: str, old: str, new: str, message: str) -> None:
    (tmp_path / "cameras.xml").write_text(xml.replace(old, new))
    with pytest.raises(ModelError, match=message):
        metashape.read_model(tmp_path / "cameras.xml")


def test_a_reconstruction_with_all_that_opensfm_writes(tmp_path: Path, small: Scene) -> None:
    """Of version 0.5 on: its reference within it, rigs, positions, and cameras that no shot has."""
    path = write_opensfm(tmp_path, small)
    content = json.loads(path.read_text())
    camera = "v2 dji fc6310 5472 3648 brown 0.6666"
    cameras: dict[str, Any] = {camera: content[0]["cameras"]["one"], "p": {"projection_type": "spherical"}}
    for place, shot in zip(small.C, content[0]["shots"].values(), strict=True):
        shot |= {"camera": camera, "orientation": 1, "gps_dop": 15.0, "gps_position": place, "covariance": []}
    content[0]["shots"]["flight 1/DJI_0001.JPG"] |= {"gps_dop": 999999.0, "gps_position": [0.0, 0.0, 0.0]}
    lla = {"latitude": LATITUDE, "longitude": LONGITUDE, "altitude": HEIGHT}
    content[0] |= {"cameras": cameras, "biases": {}, "rig_instances": {}, "reference_lla": lla}
    path.write_text(json.dumps([{**content[0], "shots": {}}, content[0]], indent=4))
    before = opensfm.read_model(write_opensfm(tmp_path / "plain", small))
    (tmp_path / "reference_lla.json").unlink()
    model = opensfm.read_model(path)
    assert model.to_geocentric is not None and before.to_geocentric is not None
    np.testing.assert_array_equal(model.to_geocentric, before.to_geocentric)
    np.testing.assert_array_equal(model.residuals(), before.residuals())
    assert np.isnan(model.reference).any(axis=1).tolist() == [name.endswith("1.JPG") for name in small.names]
    assert np.abs(model.reference[0, :2] - [LONGITUDE, LATITUDE]).max() < 1e-3
    assert model.reference[0, 2] - HEIGHT == pytest.approx(small.C[0][2], abs=1e-3)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"shots": 5}, "its shots are no items"),
        ({"reference_lla": 5}, "latitude, longitude, altitude of its reference are not all there"),
        ({"reference_lla": {"latitude": 95.0, "longitude": 0.0, "altitude": 0.0}}, "latitude, longitude, altitude"),
        ({"gps_position": [1.0, float("nan"), 2.0]}, "the gps_position of shot flight 0/DJI_0000.JPG is not three"),
    ],
)
def test_parts_of_a_reconstruction_that_are_none(
    tmp_path: Path, small: Scene, changed: dict[str, Any], message: str
) -> None:
    path = write_opensfm(tmp_path, small)
    content = json.loads(path.read_text())
    (content[0]["shots"]["flight 0/DJI_0000.JPG"] if "gps_position" in changed else content[0]).update(changed)
    path.write_text(json.dumps(content))
    with pytest.raises(ModelError, match=rf"reconstruction\.json: {message}"):
        opensfm.read_model(path)


def test_positions_of_a_model_are_observed_unless_none_are_wanted(tmp_path: Path) -> None:
    of = scene(0.4)
    path = write_opensfm(tmp_path / "model", of)
    content = json.loads(path.read_text())
    for place, shot in zip(of.C, content[0]["shots"].values(), strict=True):
        shot |= {"gps_dop": 15.0, "gps_position": place}
    path.write_text(json.dumps(content))
    gcp = gcp_list(tmp_path / "gcp_list.txt", of)
    done = imported(Asked(form="opensfm", path=path.parent, gcp=gcp), "T")
    stations = done.block.photos.position_sigma
    assert np.isfinite(stations[:, :2]).all() and np.isnan(stations[:, 2]).all()
    assert not any(line.startswith("times") for line in done.lines)
    without = imported(Asked(form="opensfm", path=path.parent, gcp=gcp, gnss=Path("none")), "T")
    assert np.isnan(without.block.photos.position_sigma).all()


@pytest.mark.parametrize(
    "change", [lambda t: "\ufeff" + t, lambda t: "  # x\n" + t, lambda t: t.replace("\n", " \r\n")]
)
def test_text_of_colmap_that_editors_have_changed(tmp_path: Path, small: Scene, change: Any) -> None:
    expected = colmap.read_model(write_colmap(tmp_path, small))
    for name in ("cameras.txt", "images.txt", "points3D.txt"):
        (tmp_path / name).write_text(change((tmp_path / name).read_text()), newline="")
    model = colmap.read_model(tmp_path)
    assert model.photos.tolist() == expected.photos.tolist()
    np.testing.assert_array_equal(model.residuals(), expected.residuals())


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("WGS84 UTM 20N", "+proj=utm +zone=20 +north +ellps=WGS84 +datum=WGS84 +units=m +no_defs=True"),
        ("WGS84 UTM 20N", "'+proj=utm +zone=20 +ellps=WGS84 +datum=WGS84 +units=m +no_defs'"),
        (r"(?m)^(\S+)\t(\S+)\t", r"\1 \2 "),
        (r"(?m)^(\S+)\t(\S+)\t(\S+)\t", r"\1 \2  \3 \t"),
    ],
)
def test_forms_of_gcp_lists(tmp_path: Path, small: Scene, old: str, new: str) -> None:
    model = colmap.read_model(write_colmap(tmp_path, small))
    path = gcp_list(tmp_path / "gcp_list.txt", small, points=(2, 9))
    text = path.read_text().replace("flight 0/", "").replace("flight 1/", "")
    path.write_text(text)
    expected = read_control(path, model)
    path.write_text(re.sub(old, new, text))
    control = read_control(path, model)
    np.testing.assert_array_equal(control.pixel, expected.pixel)
    np.testing.assert_array_equal(control.position, expected.position)
    path.write_text("WGS84\n" + text.partition("\n")[2])
    assert read_control(path, model).system == "EPSG:4326"


def test_readings_as_noaa_has_them(tmp_path: Path) -> None:
    """Of its page, day and time apart and zones above, and of its interface, with readings that are missing."""
    minutes = range(0, 60, 6)
    page = '"Date","Time (GMT)","Predicted (m)","Preliminary (m)","Verified (m)"\n'
    page += "".join(f'"2024/05/17","12:{m:02d}","9","-","{"-" if m == 30 else m / 100}"\n' for m in minutes)
    service = "Date Time, Water Level, Sigma, O or I (for verified), F, R, L, Quality \n"
    service += "".join(f"2024-05-17 12:{m:02d},{'' if m == 30 else m / 100},0.003,0,0,0,0,v\n" for m in minutes)
    for text, zone, sigma in ((page, "", 0.01), (service, "UTC", 0.003)):
        (tmp_path / "tide.csv").write_text(text)
        tide = read_tide(tmp_path / "tide.csv", ModelError, zone, 0.01)
        assert (tide.time - 1715947200.0).tolist() == [60.0 * m for m in minutes if m != 30]
        assert tide.level.tolist() == [m / 100 for m in minutes if m != 30] and set(tide.sigma) == {sigma}
    (tmp_path / "tide.csv").write_text(page.replace("(m)", "(ft)"))
    with pytest.raises(ModelError, match="column Verified is in ft: m is needed"):
        read_tide(tmp_path / "tide.csv", ModelError)


def test_exposures_as_older_versions_of_exiftool_print_them(tmp_path: Path) -> None:
    """Tags of DJI beside those of EXIF, by capitals only, and dashes (-f) for what is missing."""
    head = "SourceFile,GpsLatitude,GpsLongtitude,RtkFlag,DateTimeOriginal,OffsetTimeOriginal,"
    head += "GPSLatitudeRef,GPSLatitude,GPSLongitudeRef,GPSLongitude,GPSAltitude\n"
    row = "a.jpg,-33.5,+151.25,-,2019:06:05 10:11:12,+10:00,S,33.5,E,151.25,12\n"
    (tmp_path / "exif.csv").write_text(head + row)
    read = read_exposures(tmp_path / "exif.csv")
    assert np.degrees(read.position[0, :2]) == pytest.approx([-33.5, 151.25]) and not read.rtk.any()
    (tmp_path / "exif.csv").write_text((head + row).replace(",-33.5,", ",33 deg 30' S,"))
    with pytest.raises(ModelError, match="is not a number from -90 to 90, as 'exiftool -n' prints it"):
        read_exposures(tmp_path / "exif.csv")


def test_geojson_in_the_system_that_it_states(tmp_path: Path) -> None:
    """As QGIS writes it, beside a feature that has no place."""
    plan = np.array([[-64.9, 18.3], [-64.8, 18.3]])
    ring = [[-64.95, 18.25], [-64.85, 18.25], [-64.85, 18.35], [-64.95, 18.35], [-64.95, 18.25]]
    way = pyproj.Transformer.from_crs("OGC:CRS84", "EPSG:32620", always_xy=True)
    geometry = {"type": "MultiPolygon", "coordinates": [[[[*way.transform(*place), 0.0] for place in ring]]]}
    features: list[Any] = [{"type": "Feature", "geometry": each} for each in (None, geometry)]
    content: dict[str, Any] = {"type": "FeatureCollection", "features": features}
    path = tmp_path / "water.geojson"
    path.write_text(
        json.dumps(content | {"crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32620"}}})
    )
    assert read_water(path, geographic=True).holds(plan).tolist() == [True, False]
    path.write_text(json.dumps(content | {"crs": {"type": "name", "properties": {"name": "EPSG:1"}}}))
    with pytest.raises(
        ModelError, match=r"water\.geojson: it has the coordinate system EPSG:1; expected: one that PROJ"
    ):
        read_water(path, geographic=True)


def test_images_that_opensfm_has_left_out_of_its_bundle(tmp_path: Path) -> None:
    """They stay in its tracks, and would have the run of the job rejected."""
    of = scene(0.4)
    path = write_opensfm(tmp_path / "model", of)
    gcp = gcp_list(tmp_path / "gcp_list.txt", of)
    asked = Asked(form="opensfm", path=path.parent, gcp=gcp, per_photo=0)
    before = imported(asked, "T")
    tracks = path.with_name("tracks.csv")
    rows = tracks.read_text().splitlines()
    for row in (5, 77):
        words = rows[row].split("\t")
        rows[row] = "\t".join([*words[:3], repr(float(words[3]) + 40 / 4000), *words[4:]])
    tracks.write_text("\n".join(rows) + "\n")
    done = imported(asked, "T")
    assert len(done.block.plates.xy) == len(before.block.plates.xy) - 2
    assert any(re.match(r"2 images that miss dry points by more than \d\.\d px", text) for text in done.warnings)
    assert not any("miss" in text for text in before.warnings)
    flags = tmp_path / "flags.csv"
    flags.write_text("point,wet\n" + "".join(f"{name},1\n" for name in opensfm.read_model(path).points))
    wet = imported(replace(asked, flags=flags, level=0.0), "T")  # whose rays water bends as far
    assert not any("miss" in text for text in wet.warnings)
