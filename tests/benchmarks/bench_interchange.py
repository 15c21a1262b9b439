"""Contours of a million vertices as GeoPackage and DXF: CPU seconds of writing and reading.

    python tests/benchmarks/bench_interchange.py [VERTICES]

20,000 lines for a million. Target: both written, with the contouring of a grid of a million nodes, in 15 s.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pyproj

from musatpy.interchange import dxf, geopackage
from musatpy.interchange.layers import LayerColumn, Lines

VERTICES, OF_A_LINE = 1_000_000, 50
TARGET = 15.0  # s of CPU, both written


def contours(vertices: int) -> Lines:
    """Return lines at depths of 0.5 to 6.5 m, every third one closed."""
    rng = np.random.default_rng(1)
    count = vertices // OF_A_LINE
    depths = np.arange(count) % 7 + 0.5
    paths = np.array([290000.0, 2030000.0, 0.0]) + np.cumsum(rng.normal(size=(count, OF_A_LINE, 3)), axis=1)
    paths[:, :, 2] = -depths[:, None]
    columns = {"depth": LayerColumn.of(depths, "m")}
    closed = np.arange(count) % 3 == 0
    return Lines(vertices=list(paths), closed=closed, columns=columns, crs=pyproj.CRS("EPSG:32620"))


def seconds(work: Callable[[], object]) -> float:
    """Return the CPU time that something takes."""
    start = time.process_time()
    work()
    return time.process_time() - start


def test_contours_are_written_in_time(tmp_path: Path) -> None:
    layers = {"contours": contours(VERTICES)}
    spent = seconds(lambda: geopackage.write(tmp_path / "a.gpkg", layers))
    assert spent + seconds(lambda: dxf.write(tmp_path / "a.dxf", layers)) < TARGET


def main() -> None:
    """Print the times."""
    layers = {"contours": contours(int(sys.argv[1]) if len(sys.argv) > 1 else VERTICES)}
    with TemporaryDirectory() as folder:
        for module, name in ((geopackage, "a.gpkg"), (dxf, "a.dxf")):
            path = Path(folder) / name
            written = seconds(lambda path=path, module=module: module.write(path, layers))
            read = seconds(lambda path=path, module=module: module.read(path))
            print(f"{name}: {path.stat().st_size / 1e6:.0f} MB, written in {written:.2f} s, read in {read:.2f} s")


if __name__ == "__main__":
    main()
