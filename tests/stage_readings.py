"""A compilation deck for the tests: what an operator reads in the models of fixtures/st_thomas.

`python tests/stage_readings.py` writes the files of fixtures/st_thomas_as11 again. A test holds these to it.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from musatpy import read_deck
from musatpy.arrays import FloatArray
from musatpy.formats.compilation_deck import compilation_bytes
from musatpy.geometry.collinearity import image
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.geometry.rotations import attitude_matrix
from musatpy.model.compilation import (
    Compilation,
    ContourSpec,
    ProfileSpecs,
    SoundingDatum,
    StageReadings,
    StereomodelSpecs,
)
from musatpy.simulation.raytrace import trace
from musatpy.units import DEGREE

FIXTURES = Path(__file__).parents[1] / "fixtures"
DECK = FIXTURES / "st_thomas_as11" / "st_thomas_as11.crd"
SOUNDINGS = DECK.with_name("soundings.csv")
CONTOURS = DECK.with_name("contours.csv")
MODELS = (("2122", "21", "22"), ("2223", "22", "23"))
POINTING = 0.005  # mm, 1 sigma
_INDEX = 1.34


def bottom(number: int = 120) -> FloatArray:
    """Return latitude, longitude (rad), height (m) of points on a bottom that falls from the shore to 25 m."""
    draws = np.random.default_rng(1811)
    east, south = draws.uniform(-64.9418, -64.9180, number), draws.uniform(0.0, 1.0, number)
    latitude = 18.3345 - 0.0085 * south
    height = -2.0 - 23.0 * south**1.5 + 0.3 * draws.normal(size=number)
    return np.stack([latitude * DEGREE, east * DEGREE, height], axis=1)


def line(number: int = 31) -> FloatArray:
    """Return latitude, longitude (rad), height (m) of a line down the bottom; one reading is 4 m too high."""
    south = np.linspace(0.05, 0.9, number)
    height = -2.0 - 23.0 * south**1.5
    height[12] += 4.0
    return np.stack([(18.3345 - 0.0085 * south) * DEGREE, np.full(number, -64.9352 * DEGREE), height], axis=1)


def images(photo: str, points: FloatArray) -> FloatArray:
    """Return the exact images (k, 2) mm of submerged points on a true photo of the fixture."""
    block = read_deck(FIXTURES / "st_thomas" / "st_thomas.crd")
    truth = json.loads((FIXTURES / "st_thomas" / "st_thomas.truth.json").read_text())["stations"][photo]
    assert block.ellipsoid is not None
    ellipsoid = Ellipsoid.of(block.ellipsoid)
    a, b = ellipsoid.axes
    station = np.array(truth["position"]) * [DEGREE, DEGREE, 1.0]
    camera = np.broadcast_to(ellipsoid.geocentric(station), (len(points), 3))
    level = np.full(len(points), truth["tide"])
    rays = trace(camera, points, level, _INDEX, (a, 1.0 - (b / a) ** 2))
    M = attitude_matrix(np.array(truth["attitude"]) * DEGREE) @ ellipsoid.frame(station)
    return image(rays.air, M, block.cameras.focal_length[0], block.cameras.principal_point[0])


def compilation(pointing: float = POINTING) -> Compilation:
    """Return the deck: points of the run read again, and points of the bottom, with errors of pointing."""
    block = read_deck(FIXTURES / "st_thomas" / "st_thomas.crd")
    draws = np.random.default_rng(22)
    photos = block.photos.ids.tolist()
    plates = dict(
        zip(
            zip(block.plates.photo.tolist(), block.plates.point.tolist(), strict=True), block.plates.xy, strict=True
        )
    )
    new = bottom()
    rows: list[tuple[int, str, str, bool, FloatArray]] = []
    for number, (_, left, right) in enumerate(MODELS):
        pair = photos.index(left), photos.index(right)
        for point, name in enumerate(block.points.ids.tolist()):
            if all((photo, point) in plates for photo in pair):
                xy = np.array([plates[photo, point] for photo in pair])
                rows.append((number, name, "R", bool(block.points.bathymetric[point]), xy))
        xy = np.stack([images(left, new), images(right, new)], axis=1)
        seen = np.flatnonzero((np.abs(xy) < 108.0).all(axis=(1, 2)))
        rows += [(number, f"G{point:03d}", "G", True, xy[point]) for point in seen.tolist()]
    left, right = MODELS[0][1:]
    down = np.stack([images(left, line()), images(right, line())], axis=1)
    rows += [(0, "N", "G", True, down[0]), (0, "S", "G", True, down[-1])]
    rows += [(0, "NS", "P", True, xy) for xy in down[np.random.default_rng(23).permutation(len(down))]]
    model, ids, kind, submerged, read = zip(*rows, strict=True)
    every = np.array(read)
    blank, none = np.array(["", ""]), np.full(2, np.nan)
    return Compilation(
        titles=("ST THOMAS USVI  POINTS OF THE RUN AND OF THE BOTTOM  SIMULATED",),
        models=StereomodelSpecs(
            ids=np.array([name for name, _, _ in MODELS]),
            left=np.array([left for _, left, _ in MODELS]),
            right=np.array([right for _, _, right in MODELS]),
            mode=blank,
            vertical=blank,
            tide=blank,
            rays=blank,
            pointing=np.full(2, POINTING),
            limit=none,
        ),
        stages=StageReadings(
            model=np.array(model),
            ids=np.array(ids),
            kind=np.array(kind),
            submerged=np.array(submerged),
            xy=np.round(every + pointing * draws.normal(size=every.shape), 6),
            sigma=np.full(len(every), np.nan),
        ),
        profiles=ProfileSpecs(
            ids=np.array(["NS"]),
            model=np.array([0]),
            start=np.array(["N"]),
            end=np.array(["S"]),
            step=np.array([50.0]),
            spike=np.array([2.0]),
            tolerance=np.array([0.3]),
        ),
        datum=SoundingDatum(name="MLLW", height=-0.15, sigma=0.05),
        contours=ContourSpec(interval=2.0, index=5, longest_edge=600.0, shortest=20.0),
    )


def soundings(number: int = 200) -> str:
    """Return soundings of the bottom below the datum, good to 0.1 m, three of them with gross errors."""
    draws = np.random.default_rng(44)
    south, longitude = draws.uniform(0.0, 1.0, number), draws.uniform(-64.9418, -64.9180, number)
    depth = -0.15 + 2.0 + 23.0 * south**1.5 + 0.1 * draws.normal(size=number)
    depth[[20, 90, 150]] += [10.0, -5.0, 3.0]
    rows = zip(18.3345 - 0.0085 * south, longitude, depth, strict=True)
    lines = [f"S{row:03d},{lat:.7f},{lon:.7f},{value:.2f},0.10" for row, (lat, lon, value) in enumerate(rows)]
    return "\n".join(["name,lat,lon,depth,sigma", *lines]) + "\n"


def contours(depths: tuple[float, ...] = (4.0, 10.0, 20.0, 30.0)) -> str:
    """Return the contours of the true bottom, without its scatter, below the datum: lines along parallels."""
    lines = []
    for number, depth in enumerate(depths, 1):
        south = ((depth + 0.15 - 2.0) / 23.0) ** (2.0 / 3.0)
        for longitude in np.linspace(-64.9418, -64.9180, 9).tolist():
            lines.append(f"{number},{18.3345 - 0.0085 * south:.7f},{longitude:.7f},{depth:.2f}")
    return "\n".join(["line,lat,lon,depth", *lines]) + "\n"


if __name__ == "__main__":
    DECK.parent.mkdir(exist_ok=True)
    DECK.write_bytes(compilation_bytes(compilation()))
    SOUNDINGS.write_text(soundings())
    CONTOURS.write_text(contours())
