"""Files that cannot be written to the end: the old ones stay, and nothing else is left. Extras that are missing."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from interchange.layer_samples import grid, lines, points
from musatpy.errors import InterchangeError, MissingPackageError
from musatpy.files import remove_leftovers, whole_path
from musatpy.interchange import dxf, geojson, geopackage, geotiff, las, xyz
from musatpy.interchange.layers import Grid, LayerColumn, Lines, Points

FILES: dict[str, tuple[str, Callable[[Path], None]]] = {
    "a.gpkg": ("gis", lambda path: geopackage.write(path, {"contours": lines()})),
    "a.dxf": ("gis", lambda path: dxf.write(path, {"contours": lines()})),
    "a.tif": ("gis", lambda path: geotiff.write(path, grid())),
    "a.las": ("las", lambda path: las.write(path, points())),
    "a.csv": ("", lambda path: xyz.write(path, points())),
    "a.geojson": ("", lambda path: geojson.write(path, lines())),
}
READERS: dict[str, Callable[[Path], object]] = {
    "a.gpkg": geopackage.read,
    "a.dxf": dxf.read,
    "a.tif": geotiff.read,
    "a.las": las.read,
    "a.csv": xyz.read,
    "a.geojson": geojson.read,
}


# A limit of the size of files is a full disk that needs no disk: GDAL and SQLite meet it as everyone does.
FULL_DISK = """
import resource, signal, sys
from pathlib import Path
from interchange.test_whole_files import FILES
name, limit, folder = sys.argv[1:]
path = Path(folder) / name
FILES[name][1](path.with_name("first"))
path.with_name("first").unlink()
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
try:
    FILES[name][1](path)
except Exception as error:
    print(type(error).__name__, error)
"""


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_a_full_disk_leaves_the_old_file(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"of an earlier run")
    limit = 40_000 if name == "a.gpkg" else 256
    tests = str(Path(__file__).parents[1])
    environment = os.environ | {"PYTHONPATH": tests}
    ran = subprocess.run(
        [sys.executable, "-B", "-c", FULL_DISK, name, str(limit), str(tmp_path)],
        capture_output=True,
        text=True,
        env=environment,
        check=True,
    )
    assert ran.stdout.startswith(("OSError", "InterchangeError")) and str(tmp_path / name) in ran.stdout
    assert [left.name for left in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_bytes() == b"of an earlier run"


NONE = replace(points(), xyz=np.empty((0, 3)), columns={})


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        *((name, b"", "the file is empty") for name in FILES),
        ("a.gpkg", b"SQLite format 3\0" + bytes(900), "is no GeoPackage"),
        ("a.gpkg", partial(geopackage.write, layers={"none": NONE}), "layer none: it has no features"),
        ("a.dxf", b"nothing\n", "is no DXF file"),
        ("a.dxf", b"0\nSECTION\n2\nENTITIES\n0\nPOI", "is no DXF file"),
        ("a.tif", b"II*\0" + bytes(60), "is no raster that GDAL reads"),
        ("a.las", b"LASF" + bytes(900), "is no LAS file"),
        ("a.las", partial(las.write, points=NONE), "there are no points"),
        ("a.csv", b"x,y,z\n", "there are no points"),
        ("a.csv", b"1 2 3\n1 2 nan\n", ":2 cols 5-7 z: 'nan'"),
        ("a.geojson", b'{"features": [', "is no GeoJSON"),
        ("a.geojson", b"[" * 99999, "is no GeoJSON"),
    ],
)
def test_files_that_are_none(
    tmp_path: Path, name: str, content: bytes | Callable[[Path], None], words: str
) -> None:
    path = tmp_path / name
    with pytest.raises(FileNotFoundError):
        READERS[name](path)
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        content(path)
    with pytest.raises(InterchangeError, match=words) as caught:
        READERS[name](path)
    assert caught.value.problems[0].file == str(path)


@pytest.mark.parametrize("name", FILES)
def test_a_folder_is_no_file(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(OSError, match=name):
        FILES[name][1](tmp_path / name)


@pytest.mark.parametrize("name", FILES)
def test_a_missing_folder_is_made(tmp_path: Path, name: str) -> None:
    FILES[name][1](tmp_path / "new" / name)
    assert [left.name for left in (tmp_path / "new").iterdir()] == [name]


@pytest.mark.parametrize("name", FILES)
def test_what_a_killed_process_left_is_removed(tmp_path: Path, name: str) -> None:
    ended = subprocess.Popen([sys.executable, "-c", "pass"])
    ended.wait()
    (tmp_path / f".{name}.{ended.pid}.{'0' * 16}").write_bytes(b"half a fi")
    FILES[name][1](tmp_path / name)
    assert [left.name for left in tmp_path.iterdir()] == [name]


def test_what_a_killed_process_left_of_a_database(tmp_path: Path) -> None:
    """Packages write in a folder; its name is that of the file, and of the process."""
    ended = subprocess.Popen([sys.executable, "-c", "pass"])
    ended.wait()
    ours, others = (tmp_path / f".{name}.gpkg.{ended.pid}.{'a' * 16}" for name in "ab")
    for folder in (ours, others):
        folder.mkdir()
        (folder / "a.gpkg-journal").write_bytes(b"half a da")
    remove_leftovers([tmp_path / "a.gpkg"])
    assert list(tmp_path.iterdir()) == [others]


def test_a_failure_leaves_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    with pytest.raises(RuntimeError), whole_path(tmp_path / "a") as temporary:
        temporary.write_text("half a fi")
        temporary.with_name(f"{temporary.name}-journal").write_text("journal")
        raise RuntimeError
    assert [(left.name, left.read_text()) for left in tmp_path.iterdir()] == [("a", "old")]


@pytest.mark.parametrize(("name", "extra"), [(name, extra) for name, (extra, _) in FILES.items() if extra])
def test_a_missing_package_is_named(tmp_path: Path, name: str, extra: str, monkeypatch: pytest.MonkeyPatch) -> None:
    FILES[name][1](tmp_path / name)
    for module in [*sys.modules]:
        if module.partition(".")[0] in ("pyogrio", "rasterio", "ezdxf", "shapely", "laspy"):
            monkeypatch.setitem(sys.modules, module, None)
    for module in ("pyogrio", "pyogrio.raw", "rasterio", "ezdxf", "ezdxf.addons.r12writer", "shapely", "laspy"):
        monkeypatch.setitem(sys.modules, module, None)
    for work in (FILES[name][1], READERS[name]):
        with pytest.raises(MissingPackageError, match=rf"need the package \w+: pip install 'musatpy\[{extra}\]'"):
            work(tmp_path / name)
    for plain in ("a.csv", "a.geojson"):
        FILES[plain][1](tmp_path / plain)


@pytest.mark.parametrize(
    "make",
    [
        partial(Points, xyz=np.zeros((3, 2))),
        partial(Points, xyz=np.full((3, 3), np.nan)),
        partial(Lines, vertices=[np.full((3, 3), np.inf)], closed=np.array([False])),
        partial(Points, xyz=np.zeros((3, 3)), columns={"a": LayerColumn.of([1.0])}),
        partial(Lines, vertices=[np.zeros((1, 3))], closed=np.array([False])),
        partial(Lines, vertices=[np.zeros((2, 3))], closed=np.array([])),
        partial(Grid, west=0.0, south=0.0, spacing=1.0, bands={"a": np.zeros((2, 3)), "b": np.zeros((3, 2))}),
        partial(Grid, west=0.0, south=0.0, spacing=0.0, bands={"a": np.zeros((2, 3))}),
        partial(Grid, west=0.0, south=0.0, spacing=1.0, bands={}),
    ],
)
def test_layers_of_wrong_shapes(make: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match=r"shape|rows|closed|spacing|no number"):
        make()


def test_a_raster_that_is_not_read_as_it_was_written_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a file system loses without a word shows when the file is read again."""
    monkeypatch.setattr(geotiff, "_sum", lambda *_: 0)
    with pytest.raises(InterchangeError, match="the file differs from what was written"):
        geotiff.write(tmp_path / "a.tif", grid())
    assert not list(tmp_path.iterdir())
