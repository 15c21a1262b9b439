"""Control in three forms, and where it puts a model, against the truth of a scene."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
import pytest

from musatpy.errors import SystemsError
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.sfm import metashape, opensfm
from musatpy.sfm.control import ImagedControl, read_control
from musatpy.sfm.georeference import Georeference, georeferenced, level_positions
from musatpy.sfm.model import Model, ModelError
from sfm.written_models import LATITUDE, LONGITUDE, Scene, geocentric, scene, write_metashape, write_opensfm

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases" / "sfm"
WGS84 = Ellipsoid("WGS84")
UTM = "EPSG:32620"
GIVEN = (2, 9, 20, 33, 41, 50)  # points of the scene that are control


@pytest.fixture(scope="module")
def exact() -> Scene:
    return scene()


@pytest.fixture(scope="module")
def chunk(tmp_path_factory: pytest.TempPathFactory, exact: Scene) -> Model:
    """The model in the coordinates of a chunk, which says nothing of where it stands."""
    path = write_metashape(tmp_path_factory.mktemp("chunk") / "cameras.xml", exact)
    return replace(metashape.read_model(path), to_geocentric=None)


def in_utm(X: list[float]) -> tuple[float, float, float]:
    """Return a place of the scene in UTM 20 N, by pyproj alone."""
    return pyproj.Transformer.from_crs("EPSG:4978", UTM, always_xy=True).transform(*geocentric(X))


def images_of(of: Scene, point: int) -> list[tuple[str, float, float]]:
    return [(of.names[photo], u, v) for photo, k, u, v in of.images if k == point]


def gcp_list(path: Path, of: Scene, points: tuple[int, ...] = GIVEN, system: str = "WGS84 UTM 20N") -> Path:
    lines = [system]
    for k in points:
        x, y, z = in_utm(of.points[k])
        for name, u, v in images_of(of, k):
            lines.append(f"{x!r}\t{y!r}\t{z!r}\t{u - 0.5!r}\t{v - 0.5!r}\t{name}\tG{k}\textra")
    path.write_text("\n".join(lines) + "\n")
    return path


def table(path: Path, of: Scene) -> Path:
    lines = ["point,easting,northing,height,photo,px,py,sigma,check"]
    for k in GIVEN:
        x, y, z = in_utm(of.points[k])
        lines.append(f"G{k},{x!r},{y!r},{z!r},,,,0.02,{'check' if k == GIVEN[-1] else ''}")
        lines += [f"G{k},,,,{name.rpartition('/')[2].lower()},{u!r},{v!r},," for name, u, v in images_of(of, k)]
    path.write_text("\n".join(lines) + "\n")
    return path


def markers(path: Path, of: Scene) -> Path:
    marker, located = "", ""
    for k in GIVEN:
        x, y, z = in_utm(of.points[k])
        enabled = "false" if k == GIVEN[-1] else "true"
        reference = f'<reference x="{x!r}" y="{y!r}" z="{z!r}" sxyz="0.02" enabled="{enabled}"/>'
        marker += f'<marker id="{k}" label="G{k}">{reference}</marker>'
        places = "".join(
            f'<location camera_id="{photo}" pinned="true" x="{u!r}" y="{v!r}"/>'
            for photo, point, u, v in of.images
            if point == k
        )
        located += f'<marker marker_id="{k}">{places}<location camera_id="0" x="1" y="1"/></marker>'
    zero = "TOWGS84[0,0,0,0,0,0,0]"
    wkt = pyproj.CRS(UTM).to_wkt("WKT1_GDAL").replace("]],\n", "]],", 1)
    wkt = wkt.replace('AUTHORITY["EPSG","6326"]', f'{zero},AUTHORITY["EPSG","6326"]')
    assert zero in wkt
    frames = f"<frames><frame><markers>{located}</markers></frame></frames>"
    more = f"<markers>{marker}</markers>{frames}<marker_reference>{wkt}</marker_reference>"
    return write_metashape(path, of, markers=more)


def placed(model: Model, control: ImagedControl, **options: bool) -> Georeference:
    level, ellipsoid = level_positions(control.position, control.system, UTM)
    return georeferenced(model, ellipsoid, control, level, **options)


def test_control_in_another_system_than_positions(exact: Scene, tmp_path: Path, chunk: Model) -> None:
    control = read_control(gcp_list(tmp_path / "gcp_list.txt", exact, system="WGS84 UTM 33N"), chunk)
    level, ellipsoid = level_positions(control.position, control.system)
    at = WGS84.geographic(np.array([geocentric(C) for C in exact.C]))
    with pytest.raises(ModelError, match=r"gcp_list\.txt: control is 7,\d\d\d km from the positions of the photos"):
        georeferenced(chunk, ellipsoid, control, level, at, np.ones(at.shape))
    level, ellipsoid = level_positions(control.position, UTM)
    model = opensfm.read_model(write_opensfm(tmp_path, exact))
    for positions in (at + np.array([0.0, 0.0, 30.0]), np.roll(at, 1, axis=0)):  # of a geoid, of other photos
        with pytest.raises(
            ModelError, match=r"does not fit its places: it misses 6 control points by [\d., ]+ m and 12"
        ):
            georeferenced(model, ellipsoid, control, level, positions, np.full(at.shape, 0.03))
    with pytest.raises(
        ModelError, match=r"gcp_list\.txt: images of control miss .* measured on photos of another size"
    ):
        georeferenced(chunk, ellipsoid, replace(control, pixel=0.5 * control.pixel), level)


def off_truth(of: Scene, model: Model, found: Georeference) -> float:
    """Return the largest error of a station, m."""
    at = found.placement
    there = at.scale * model.centre @ at.rotation.T + at.shift
    return float(np.abs(there - [geocentric(C) for C in of.C]).max())


@pytest.mark.parametrize(
    ("name", "write"), [("gcp_list.txt", gcp_list), ("points.csv", table), ("markers.xml", markers)]
)
def test_control_puts_a_model_where_it_is(
    tmp_path: Path, exact: Scene, chunk: Model, name: str, write: Callable[[Path, Scene], Path]
) -> None:
    control = read_control(write(tmp_path / name, exact), chunk)
    assert control.ids.tolist() == [f"G{k}" for k in GIVEN]
    truth = {(exact.names[p], f"G{k}"): (u, v) for p, k, u, v in exact.images if k in GIVEN}
    pixels = {
        (chunk.photos[p], control.ids[k]): tuple(at)
        for p, k, at in zip(control.photo, control.point, control.pixel, strict=True)
    }
    assert pixels.keys() == truth.keys()
    assert all(np.allclose(pixels[key], truth[key], rtol=0, atol=1e-9) for key in truth)
    found = placed(chunk, control)
    assert off_truth(exact, chunk, found) < 1e-4
    assert np.abs(found.control).max() < 1e-4 and np.isnan(found.photos).all()
    assert found.wrong == () and found.notes == ()
    checks = [False] * 6 if name == "gcp_list.txt" else [False] * 5 + [True]
    assert control.check.tolist() == checks
    assert np.isnan(control.sigma).all() if name == "gcp_list.txt" else (control.sigma == 0.02).all()


def test_checks_do_not_take_part(tmp_path: Path, exact: Scene, chunk: Model) -> None:
    control = read_control(table(tmp_path / "a.csv", exact), chunk)
    control.position[5, 2] += 4.0
    found = placed(chunk, control)
    assert off_truth(exact, chunk, found) < 1e-4
    assert found.control[5] == pytest.approx([0.0, 0.0, -4.0], abs=1e-3)
    assert found.wrong == ()


def test_wrong_coordinates_are_named(tmp_path: Path, exact: Scene, chunk: Model) -> None:
    control = read_control(gcp_list(tmp_path / "gcp_list.txt", exact), chunk)
    control.position[1, 0] += 10.0
    found = placed(chunk, control)
    assert off_truth(exact, chunk, found) < 0.05
    assert len(found.wrong) == 1 and found.wrong[0].startswith("control point G9 is -10.0")


def test_a_wrong_image_is_named(tmp_path: Path, exact: Scene, chunk: Model) -> None:
    control = read_control(gcp_list(tmp_path / "gcp_list.txt", exact), chunk)
    row = int(np.flatnonzero(np.bincount(control.point)[control.point] > 3)[0])
    control.pixel[row] += [300.0, -200.0]
    found = placed(chunk, control)
    point, photo = control.ids[control.point[row]], chunk.photos[control.photo[row]]
    assert any(text.startswith(f"control point {point} is 3") and text.endswith(photo) for text in found.wrong)
    assert off_truth(exact, chunk, found) < 0.5


def test_three_points_do_not_check_one_another(tmp_path: Path, exact: Scene, chunk: Model) -> None:
    found = placed(chunk, read_control(gcp_list(tmp_path / "gcp_list.txt", exact, GIVEN[:3]), chunk))
    assert off_truth(exact, chunk, found) < 1e-3
    assert found.notes == ("three places fix the model, and do not check one another",)


def test_two_points_are_too_few(tmp_path: Path, exact: Scene, chunk: Model) -> None:
    control = read_control(gcp_list(tmp_path / "gcp_list.txt", exact, GIVEN[:2]), chunk)
    with pytest.raises(ModelError, match="2 control points with coordinates and two images or more, and 0 photos"):
        placed(chunk, control)


def stations_of(of: Scene, noise: float, seed: int = 3) -> np.ndarray:
    level = WGS84.geographic(np.array([geocentric(C) for C in of.C]))
    return level + np.random.default_rng(seed).normal(0.0, noise, level.shape) / [6.37e6, 6.05e6, 1.0]


@pytest.mark.parametrize("metric", [False, True])
def test_positions_of_photos_put_a_model_where_it_is(tmp_path: Path, exact: Scene, metric: bool) -> None:
    model = opensfm.read_model(write_opensfm(tmp_path, exact))
    level = stations_of(exact, 0.02)
    level[4, 2] += 40.0
    sigma = np.full(level.shape, 0.02)
    found = georeferenced(model, WGS84, station_level=level, station_sigma=sigma, metric=metric)
    assert off_truth(exact, model, found) < 0.05
    assert (found.placement.scale == 1.0) == metric
    assert [text.split(" is ")[0] for text in found.wrong] == [f"photo {exact.names[4]}"]
    assert found.photos[4, 2] == pytest.approx(-40.0, abs=0.1)


def test_bad_heights_do_not_draw_the_plan(exact: Scene, chunk: Model) -> None:
    """Heights without RTK: of Metashape's real file they are off by 44 m; control settles them."""
    level = stations_of(exact, 0.5)
    level[:, 2] += np.random.default_rng(1).normal(0.0, 20.0, len(level))
    found = georeferenced(
        chunk, WGS84, station_level=level, station_sigma=np.full((len(level), 3), [1.0, 1.0, 10.0])
    )
    assert np.abs(found.photos[:, :2]).max() < 4.0 and np.abs(found.photos[:, 2]).max() > 15.0


def test_photos_on_a_line_leave_a_turn_free(exact: Scene, chunk: Model, tmp_path: Path) -> None:
    level = stations_of(exact, 0.0)
    level[4:] = np.nan
    sigma = np.full(level.shape, 2.0)
    with pytest.raises(ModelError, match="the 4 places that fit leave a turn of the model free") as refused:
        georeferenced(chunk, WGS84, station_level=level, station_sigma=sigma)
    assert "a control point off that line is lacking" in str(refused.value)
    control = read_control(gcp_list(tmp_path / "gcp_list.txt", exact, GIVEN[:2]), chunk)
    place, ellipsoid = level_positions(control.position, control.system)
    assert ellipsoid is not None
    found = georeferenced(chunk, ellipsoid, control, place, level, sigma)
    assert off_truth(exact, chunk, found) < 0.1


def test_the_file_itself_says_where_it_stands(tmp_path: Path, exact: Scene) -> None:
    model = metashape.read_model(write_metashape(tmp_path / "cameras.xml", exact))
    assert model.to_geocentric is not None
    A = model.to_geocentric[:3, :3] / 22.5
    level = WGS84.geographic(model.centre @ model.to_geocentric[:3, :3].T + model.to_geocentric[:3, 3])
    assert level == pytest.approx(stations_of(exact, 0.0), abs=1e-4)
    assert np.allclose(A @ A.T, np.eye(3), rtol=0, atol=1e-9)


def test_local_metres(tmp_path: Path, exact: Scene, chunk: Model) -> None:
    lines = ["name x y z photo px py"]
    for k in GIVEN:
        X = " ".join(map(repr, exact.points[k]))
        lines += [f'G{k} {X} "{name}" {u!r} {v!r}' for name, u, v in images_of(exact, k)]
    (tmp_path / "local.txt").write_text("\n".join(lines) + "\n")
    control = read_control(tmp_path / "local.txt", chunk)
    with pytest.raises(SystemsError, match="no coordinate system is stated: give --crs"):
        level_positions(control.position, control.system)
    level, ellipsoid = level_positions(control.position, control.system, "local")
    found = georeferenced(chunk, ellipsoid, control, level)
    assert ellipsoid is None
    assert found.placement.positions(chunk.centre) == pytest.approx(np.array(exact.C), abs=1e-4)


@pytest.mark.parametrize(
    ("system", "message"),
    [
        ("EPSG:2227", "it is in US survey foot, and heights beside it may be too: give metres"),
        ("EPSG:32620+5703", "the grid file of its geoid model is needed"),
        ("EPSG:26717", "EPSG:26717 stands on another ellipsoid than WGS 84 and GRS 80: no datum is shifted"),
        ("EPSG:999999", "is no coordinate system that PROJ knows"),
    ],
)
def test_systems_that_are_refused(system: str, message: str) -> None:
    with pytest.raises(SystemsError, match=message):
        level_positions(np.array([[500000.0, 2e6, 0.0]]), system)
    if not system.startswith(("EPSG:2227", "EPSG:26717")):  # --crs beside the system of a file is no good either
        with pytest.raises(SystemsError, match=message):
            level_positions(np.array([[500000.0, 2e6, 0.0]]), UTM, system)


def test_degrees_are_of_wgs_84(tmp_path: Path, chunk: Model) -> None:
    (tmp_path / "a.csv").write_text(f"id,lat,lon,z\nA,{LATITUDE},{LONGITUDE},-40\n")
    control = read_control(tmp_path / "a.csv", chunk)
    level, _ = level_positions(control.position, control.system)
    assert WGS84.geocentric(level[0]) == pytest.approx(geocentric([0.0, 0.0, 0.0]), abs=1e-4)


BAD: list[tuple[str, str, str]] = [
    ("gcp_list.txt", "{utm}\n1 2 3 4 x a.jpg\n", "gcp_list.txt:2: '1 2 3 4 x a.jpg' is not x y z px py photo"),
    ("gcp_list.txt", "{utm}\n1 2 nan 4 5 a.jpg\n", "gcp_list.txt:2: '1 2 nan 4 5 a.jpg' is not x y z px py photo"),
    ("gcp_list.txt", "1 2 3 4 5 {photo}\n", "gcp_list.txt:1: '1 2 3 4 5 "),
    ("gcp_list.txt", "12\t13\t{photo}\n", "images without coordinates or names belong to no point"),
    ("gcp_list.txt", "{utm}\n1\t2\t3\t4\t5\tno.jpg\n", "1 photo of control not in the model: no.jpg"),
    (
        "gcp_list.txt",
        "{utm}\n1\t2\t3\t4\t5000\t{photo}\n",
        "gcp_list.txt:2: control point gcp1: pixel 4.5, 5000.5 is",
    ),
    (
        "gcp_list.txt",
        "{utm}\n1\t2\t3\t4\t5\t{photo}\n1\t2\t3\t4\t5\t{photo}\n",
        "gcp_list.txt:3: control point gcp1: it",
    ),
    (
        "gcp_list.txt",
        "{utm}\n1\t2\t3\t4\t5\t{photo}\tA\n1\t2\t4\t4\t5\t{photo}\tA\n",
        "gcp_list.txt:3: control point A: it has other coordinates than before",
    ),
    ("a.csv", "id,x,y,z\nA,1,2,\n", "a.csv:2 col 1 id: a point has three coordinates or none"),
    ("a.csv", "id,x,y,z,photo,px,py\nA,1,2,3,b.jpg,4,\n", "photo, px and py go together"),
    ("a.csv", "id,x,y,z\nA,1,2,abc\n", "a.csv:2 cols 7-9 z: 'abc' is not a number"),
    ("a.csv", "id,x,y\nA,1,2\n", "a.csv:1: no columns"),
    ("a.csv", "id,x,y,z\n", "a.csv: it has no control point"),
    ("a.xml", "<document><chunk/></document>", "a.xml: it has no markers"),
]


@pytest.mark.parametrize(("name", "text", "message"), BAD)
def test_faults_are_told_with_their_places(
    tmp_path: Path, chunk: Model, name: str, text: str, message: str
) -> None:
    (tmp_path / name).write_text(text.replace("{utm}", UTM).replace("{photo}", chunk.photos[0]))
    with pytest.raises(ModelError) as refused:
        read_control(tmp_path / name, chunk)
    assert message in str(refused.value)


def test_names_that_several_photos_have(tmp_path: Path, chunk: Model) -> None:
    """As in a real file, of whose 922 labels only 622 have different file names."""
    model = replace(chunk, photos=np.array(["a/1.jpg", "b/1.jpg", *chunk.photos[2:]]))
    (tmp_path / "gcp_list.txt").write_text(f"{UTM}\n1\t2\t3\t4\t5\t1.jpg\n")
    with pytest.raises(ModelError, match=r"gcp_list\.txt:2: control point gcp1: several photos are called 1\.jpg"):
        read_control(tmp_path / "gcp_list.txt", model)
    (tmp_path / "gcp_list.txt").write_text(f"{UTM}\n1\t2\t3\t4\t5\tb/1.jpg\n1\t2\t3\t4\t5\tmissing.jpg\n")
    control = read_control(tmp_path / "gcp_list.txt", model)
    assert control.photo.tolist() == [1]
    assert control.notes == ("1 photo of control not in the model: missing.jpg",)


@pytest.mark.skipif(not CASES.is_dir(), reason="the real lists stand beside the project, not in it")
def test_a_real_list_in_three_states(chunk: Model) -> None:
    folder = CASES / "odm_copr"
    names = sorted({line.split("\t")[5] for line in (folder / "gcp_list.txt").read_text().splitlines()[1:]})
    assert len(names) == 22
    lens = replace(chunk.lenses[0], width=4320, height=3240)
    few = replace(
        chunk, photos=np.array(names), lenses=(lens,), camera=np.zeros(22, dtype=int), centre=np.zeros((22, 3))
    )
    control = read_control(folder / "gcp_list.txt", few)
    assert control.ids.tolist() == [
        "gcp02",
        "gcp04",
        "gcp09",
        "gcp08",
        "gcp07",
        "gcp05",
        "gcp03",
        "gcp01",
        "gcp00",
        "gcp06",
    ]
    assert len(control.photo) == 27
    assert control.pixel[0] == pytest.approx([3609.8727839973153, 2294.2951481487607], abs=1e-9)
    level, ellipsoid = level_positions(control.position, control.system)
    assert ellipsoid is not None and ellipsoid.has_axes(6378137.0, 6356752.314245)
    assert np.degrees(level[0, :2]) == pytest.approx([34.4083, -119.8799], abs=2e-4)
    points = read_control(folder / "gcp_list_noimg.txt", few)
    assert len(points.ids) == 10 and len(points.photo) == 0
    level, _ = level_positions(points.position, points.system)
    assert np.degrees(level[0, :2]) == pytest.approx([34.4082988202, -119.879992097], abs=1e-9)
    with pytest.raises(ModelError, match="images without coordinates or names belong to no point"):
        read_control(folder / "gcp_list_nocoord.txt", few)
