"""`musat import` of a scene by the command: systems with heights above a geoid, and positions without heights."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from musatpy import adjust
from musatpy.cli.main import main
from musatpy.formats.musat import read_deck
from musatpy.sfm.source import cameras_of_job
from sfm.test_control import GIVEN, UTM, gcp_list, stations_of
from sfm.written_models import LATITUDE, LONGITUDE, Scene, applied, scene, transpose, write_colmap, write_opensfm

COMPOUND = f"{UTM}+5703"
HEAD = "SourceFile,GPSLatitude,GPSLongitude,GPSAltitude,RtkFlag,RtkStdLon,RtkStdLat,RtkStdHgt"


@pytest.fixture(scope="module")
def exact() -> Scene:
    return scene()


def imported(form: str, folder: Path, *options: object, status: int = 0) -> Result:
    words = ["import", form, folder, "-o", folder / "a.job", *options]
    result = CliRunner().invoke(main, [str(word) for word in words])
    assert result.exit_code == status, result.output
    return result


def exposures(path: Path, of: Scene, fix: str) -> Path:
    level = stations_of(of, 0.0)
    level[:, :2] = np.degrees(level[:, :2])
    rows = [f"{name},{B!r},{L!r},{h!r},{fix}" for name, (B, L, h) in zip(of.names, level.tolist(), strict=True)]
    path.write_text("\n".join([HEAD, *rows]) + "\n")
    return path


def geoid(path: Path) -> Path:
    """A geoid 12.5 m below the ellipsoid over the degrees around the scene."""
    corner = [np.floor(LATITUDE) - 1.0, np.floor(LONGITUDE) - 1.0, 1.0, 1.0]
    data = np.array(corner, ">f8").tobytes() + np.array([4, 4], ">i4").tobytes()
    path.write_bytes(data + np.full((4, 4), -12.5, ">f4").tobytes())
    return path


def test_heights_of_control_above_a_geoid(tmp_path: Path, exact: Scene) -> None:
    write_colmap(tmp_path, exact)
    plain, above = (gcp_list(tmp_path / name, exact, GIVEN, UTM) for name in ("plain.txt", "above.txt"))
    lines = [line.split("\t") for line in above.read_text().splitlines()[1:]]
    rows = ["\t".join([x, y, repr(float(z) + 12.5), *more]) for x, y, z, *more in lines]
    above.write_text("\n".join([COMPOUND, *rows]) + "\n")
    grid = ("--geoid", geoid(tmp_path / "level.gtx"))
    heights = []
    for path, options in ((plain, ()), (above, grid)):
        assert (
            "placed by 6 control points: RMS east, north, up 0.000"
            in imported("colmap", tmp_path, "--gcp", path, *options).output
        )
        heights.append(read_deck(tmp_path / "a.job").control.position[:, 2])
    np.testing.assert_allclose(*heights, atol=1e-6)
    output = imported("colmap", tmp_path, "--gcp", above, status=1).output
    assert "NAVD88 height: the grid file of its geoid model is needed (--geoid)" in output


def test_positions_without_heights_take_part_in_plan(tmp_path: Path, exact: Scene) -> None:
    write_colmap(tmp_path, exact)
    gnss = ("--gnss", exposures(tmp_path / "exif.csv", exact, "16,1,1,2"))
    text = f"{len(exact.names)} photos have positions without heights of use: --heights takes them, with 10 m"
    control = ("--gcp", gcp_list(tmp_path / "gcp_list.txt", exact))
    output = imported("colmap", tmp_path, *gnss, *control).output
    assert text in output and "no level of the water is given (--tide, --level): all points are taken" in output
    output = imported("colmap", tmp_path, *gnss, *control, "--level", 131.0, status=1).output
    assert "the water at 131.00 m is above the lowest photo" in output and "add_photo" not in output
    photos = read_deck(tmp_path / "a.job").photos
    np.testing.assert_array_equal(photos.position_sigma, np.tile([5.0, 5.0, np.nan], (len(exact.names), 1)))
    np.testing.assert_allclose(photos.position[:, :2], stations_of(exact, 0.0)[:, :2], atol=1e-12)
    output = imported("colmap", tmp_path, *gnss, status=1).output
    assert f"the positions of {len(exact.names)} photos have no heights of use: --heights takes them" in output
    assert text not in imported("colmap", tmp_path, *gnss, *control, "--heights").output


@pytest.mark.parametrize(("fix", "kept"), [("50,.02,.02,.03", True), ("16,1,1,2", False)])
def test_metres_of_a_model_are_kept_where_they_are_those_of_rtk(
    tmp_path: Path, exact: Scene, fix: str, kept: bool
) -> None:
    path = write_opensfm(tmp_path, exact)
    control = ("--gcp", gcp_list(tmp_path / "gcp_list.txt", exact))
    imported("opensfm", path.parent, "--gnss", exposures(tmp_path / "exif.csv", exact, fix), *control)
    assert (cameras_of_job(tmp_path / "a.job").placement.scale == 1.0) == kept


def test_positions_of_antennas_have_a_lever_arm(tmp_path: Path, exact: Scene) -> None:
    write_colmap(tmp_path, exact)
    arm = [0.3, 0.2, -1.1]  # x right, y down, z forward
    antennas = [
        [c + d for c, d in zip(C, applied(transpose(R), arm), strict=True)]
        for R, C in zip(exact.R, exact.C, strict=True)
    ]
    of_antennas = replace(exact, C=antennas)
    gnss = (
        "--gnss",
        exposures(tmp_path / "exif.csv", of_antennas, "50,.02,.02,.02"),
        "--lever-arm",
        "0.3,-0.2,1.1",
    )
    imported("colmap", tmp_path, *gnss)
    block = read_deck(tmp_path / "a.job")
    assert len(block.antenna_positions.photo) == len(exact.names) and np.isnan(block.photos.position_sigma).all()
    off = (adjust(block).stations.position - stations_of(exact, 0.0)) * [6.37e6, 6.05e6, 1.0]
    np.testing.assert_allclose(off, 0.0, atol=1e-3)  # images without noise
    plan = exposures(tmp_path / "exif.csv", of_antennas, "16,1,1,2")
    output = imported("colmap", tmp_path, "--gnss", plan, "--lever-arm", "0.3,-0.2,1.1", status=1).output
    assert "a lever arm is of positions with heights" in output


def test_components_of_colmap_are_its_folders(tmp_path: Path, exact: Scene) -> None:
    control = ("--gcp", gcp_list(tmp_path / "gcp_list.txt", exact))
    for number in ("0", "10", "2"):
        write_colmap(tmp_path / "sparse" / number, exact)
    output = imported("colmap", tmp_path, *control, status=1).output
    assert f"it has 3 components, of {', '.join([str(len(exact.names))] * 3)} photos: choose one" in output
    assert "has 3 components, and no number 4" in imported("colmap", tmp_path, "--component", 4, status=1).output
    (tmp_path / "sparse" / "2" / "points3D.txt").write_text("x\n")
    assert "sparse/2/points3D.txt:1" in imported("colmap", tmp_path, "--component", 2, status=1).output
    (tmp_path / "wet.csv").write_text("id,wet\n" + "".join(f"{2 * k + 11},1\n" for k in range(len(exact.points))))
    wet = ("--wet", tmp_path / "wet.csv", "--level", 0.0)
    output = imported("colmap", tmp_path / "sparse", "--component", 3, *control, *wet).output
    assert "no point is dry: control and positions alone tell focal length, heights of stations" in output
