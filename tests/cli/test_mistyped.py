"""What is mistyped in an option or a file is told by its own name, whichever command reads it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cli.commands import musat
from musatpy.interchange import geotiff
from musatpy.interchange.layers import Grid

ROOT = Path(__file__).parents[2]
THOMAS, COMPILED = (ROOT / f"fixtures/{name}/{name}.crd" for name in ("st_thomas", "st_thomas_as11"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the record of a run, points, a raster and a path."""
    folder = tmp_path_factory.mktemp("run")
    assert musat("run", "-q", THOMAS, "-o", folder).exit_code == 0
    (folder / "points.csv").write_text("name,lon,lat,height\na,-64.93,18.33,-30\nb,-64.931,18.33,-31\n")
    (folder / "soundings.csv").write_text("name,x,y,depth\na,300000,2026000,3\n")
    grid = Grid(west=0.0, south=0.0, spacing=1.0, bands={"depth": np.add.outer(np.arange(4.0), np.arange(4.0))})
    geotiff.write(folder / "depths.tif", grid)
    return folder


def told(folder: Path, *words: object) -> str:
    """Return what a command says that fails, in words of its own."""
    ran = musat(*(str(word).replace("DIR", str(folder)) for word in words))
    assert ran.exit_code not in (0, 3, 4) and "unexpected" not in ran.stderr and "Traceback" not in ran.stderr
    return ran.stderr


@pytest.mark.parametrize("system", ["EPSG:2672O", "+proj=utm8"])
@pytest.mark.parametrize(
    "command",
    [
        ("as11", "correct", "DIR/st_thomas.json", "21", "22", "DIR/points.csv", "-o", "DIR/true.csv"),
        ("as11", "contours", "DIR/depths.tif", "-o", "DIR/c.gpkg", "--interval", "1"),
        ("as11", "compare-soundings", "DIR/st_thomas.json", COMPILED, "DIR/soundings.csv", "-o", "DIR"),
        ("plot", "DIR/st_thomas.json", "--line", "DIR/points.csv", "-o", "DIR"),
        ("depth", "correct", "DIR/points.csv", "--cameras", "DIR/st_thomas.json", "-o", "DIR/d.csv"),
        ("run", THOMAS, "-o", "DIR/again", "--gis"),
    ],
)  # fmt: skip
def test_a_system_that_is_none(folder: Path, command: tuple[object, ...], system: str) -> None:
    assert "is no coordinate system" in told(folder, *command, "--crs", system)


@pytest.mark.parametrize("name", ["a/b", "a\\b", "a:b", "a*b", "b."])
def test_a_grid_is_part_of_the_name_of_a_file(folder: Path, name: str) -> None:
    deck = folder / "deck.crd"
    deck.write_text(COMPILED.read_text().replace("GRD BAY   ", f"GRD {name:<6}"))
    words = told(folder, "as11", "compile", "DIR/st_thomas.json", deck, "--gis")
    assert "cols 5-12 GRD.name: names files of the grid" in words


@pytest.mark.parametrize(
    "key", ["punch", "punch_points", "punch_sigmas", "record", "set", "formats", "out", "brief"]
)
@pytest.mark.parametrize("value", ["[[1, 2]]", "{a = 1}", "1979-05-27", "1.5"])
def test_a_value_of_a_manifest_that_is_none_of_its_kind(tmp_path: Path, key: str, value: str) -> None:
    manifest = tmp_path / "m.toml"
    manifest.write_text(f'[[job]]\ndeck = "{THOMAS}"\n{key} = {value}\n')
    assert f" job 1.{key}" in told(tmp_path, "batch", manifest)
    manifest.write_text(f'{key} = {value}\n[[job]]\ndeck = "{THOMAS}"\n')
    assert key in told(tmp_path, "batch", manifest)


@pytest.mark.parametrize(
    ("table", "field", "noun"),
    [
        ("station_pairs", "photos", "photo"),
        ("stations", "camera", "camera"),
        ("plates", "photo", "photo"),
        ("plates", "point", "point"),
        ("control", "point", "point"),
        ("equal_elevations", "points", "point"),
    ],
)
def test_a_link_of_a_record_to_what_it_has_not(folder: Path, table: str, field: str, noun: str) -> None:
    record: dict[str, Any] = json.loads((folder / "st_thomas.json").read_text())
    column = record[table][field]
    if isinstance(column[0], list):
        column[0][-1] = "nowhere"
    else:
        column[0] = "nowhere"
    (folder / "strange.json").write_text(json.dumps(record))
    message = f"{table}.{field}[0]: there is no {noun} nowhere in "
    assert message in told(folder, "as11", "compile", "DIR/strange.json", COMPILED, "-o", "DIR/out")
    if table != "station_pairs":  # which no page shows
        assert message in told(folder, "report", "DIR/strange.json", "-o", "DIR/out.html")


@pytest.mark.parametrize(
    "text", ["t,X,Y,Z\r0,0,0,0\r1,1,\r", '"t",X,"Y\n",Z\n0,0,0,x\n1,1,1,1\n', 't,X,"Y\r",Z\n0,0,0\n']
)
def test_line_ends_of_a_path_wherever_they_are(folder: Path, text: str) -> None:
    (folder / "path.csv").write_bytes(text.encode())
    assert "is no number" in told(folder, "as11", "drive", "DIR/st_thomas.json", "21", "22", "DIR/path.csv")
