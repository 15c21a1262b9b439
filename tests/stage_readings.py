"""Compilation decks for the tests: what an operator reads in the models of fixtures/st_thomas and cayman.

`python tests/stage_readings.py` writes the decks and soundings again. A test holds these to it.
"""

import json
from pathlib import Path

import numpy as np

from musatpy import read_deck
from musatpy.arrays import FloatArray
from musatpy.formats.compilation_deck import compilation_bytes
from musatpy.geometry.collinearity import attitude_matrix, image
from musatpy.geometry.geodesy import Ellipsoid
from musatpy.model import Block
from musatpy.model.compilation import (
    Compilation,
    ContourSpec,
    GridSpecs,
    ProfileSpecs,
    SoundingDatum,
    StageReadings,
    StereomodelSpecs,
)
from musatpy.simulation.raytrace import trace
from musatpy.units import DEGREE

FIXTURES = Path(__file__).parents[1] / "fixtures"
DECK = FIXTURES / "st_thomas_as11" / "st_thomas_as11.crd"
CAYMAN = FIXTURES / "cayman_as11" / "cayman_as11.crd"
SOUNDINGS = DECK.with_name("soundings.csv")
CONTOURS = DECK.with_name("contours.csv")
MODELS = (("2122", "21", "22"), ("2223", "22", "23"))
POINTING = 0.005  # mm, 1 sigma
_INDEX = 1.34


def changed(folder: Path, *changes: tuple[str, str]) -> Path:
    """Return the deck of the fixture with texts replaced, wherever they stand."""
    text = DECK.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    deck = folder / "changed.crd"
    deck.write_text(text)
    return deck


def bottom(number: int = 120) -> FloatArray:
    """Return latitude, longitude (rad), height (m) of points on a bottom that falls from the shore to 25 m."""
    draws = np.random.default_rng(1811)
    east, south = draws.uniform(-64.9418, -64.9180, number), draws.uniform(0.0, 1.0, number)
    latitude = 18.3345 - 0.0085 * south
    height = -2.0 - 23.0 * south**1.5 + 0.3 * draws.normal(size=number)
    return np.stack([latitude * DEGREE, east * DEGREE, height], axis=1)


def line(
    south: tuple[float, float], longitude: tuple[float, float], number: int = 31, spike: int | None = None
) -> FloatArray:
    """Return latitude, longitude (rad), height (m) of a line over the bottom; a reading may be 4 m too high."""
    down = np.linspace(*south, number)
    height = -2.0 - 23.0 * down**1.5
    if spike is not None:
        height[spike] += 4.0
    return np.stack([(18.3345 - 0.0085 * down) * DEGREE, np.linspace(*longitude, number) * DEGREE, height], axis=1)


# Name, model, points at the ends, and places: two lines down the bottom, one along it.
PROFILES = (
    ("NS", 0, ("N", "S"), line((0.05, 0.9), (-64.9352, -64.9352), spike=12)),
    ("EW", 0, ("E", "W"), line((0.5, 0.5), (-64.9280, -64.9390), 21)),
    ("SLOPE", 1, ("TOP", "FOOT"), line((0.1, 0.8), (-64.9260, -64.9220))),
)


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


Row = tuple[int, str, str, bool, FloatArray]  # model, point, class, submerged, stages (2, 2)


def read_again(block: Block, number: int, left: str, right: str) -> list[Row]:
    """Return the points that two photos of a run have measured, as readings of class R of model `number`."""
    photos = block.photos.ids.tolist()
    pair = photos.index(left), photos.index(right)
    measured = zip(block.plates.photo.tolist(), block.plates.point.tolist(), strict=True)
    plates = dict(zip(measured, block.plates.xy, strict=True))
    return [
        (
            number,
            name,
            "R",
            bool(block.points.bathymetric[point]),
            np.array([plates[photo, point] for photo in pair]),
        )
        for point, name in enumerate(block.points.ids.tolist())
        if all((photo, point) in plates for photo in pair)
    ]


def pointed(rows: list[Row], seed: int, pointing: float = POINTING) -> StageReadings:
    """Return readings with errors of pointing."""
    model, ids, kind, submerged, read = (np.array(column) for column in zip(*rows, strict=True))
    errors = pointing * np.random.default_rng(seed).normal(size=read.shape)
    return StageReadings(
        model=model, ids=ids, kind=kind, submerged=submerged, xy=np.round(read + errors, 6),
    )  # fmt: skip


def models(*names: tuple[str, str, str]) -> StereomodelSpecs:
    """Return stereomodels by name, left and right photo."""
    ids, left, right = (np.array(column) for column in zip(*names, strict=True))
    return StereomodelSpecs(ids=ids, left=left, right=right, pointing=np.full(len(ids), POINTING))


def compilation(pointing: float = POINTING) -> Compilation:
    """Return the deck of St. Thomas: points of the run read again, and points of the bottom."""
    block, new = read_deck(FIXTURES / "st_thomas" / "st_thomas.crd"), bottom()
    rows: list[Row] = []
    for number, (_, left, right) in enumerate(MODELS):
        rows += read_again(block, number, left, right)
        xy = np.stack([images(left, new), images(right, new)], axis=1)
        seen = np.flatnonzero((np.abs(xy) < 108.0).all(axis=(1, 2)))
        rows += [(number, f"G{point:03d}", "G", True, xy[point]) for point in seen.tolist()]
    for seed, (name, number, (start, end), line) in enumerate(PROFILES, 23):
        read = np.stack([images(photo, line) for photo in MODELS[number][1:]], axis=1)
        rows += [(number, start, "G", True, read[0]), (number, end, "G", True, read[-1])]
        rows += [(number, name, "P", True, xy) for xy in read[np.random.default_rng(seed).permutation(len(read))]]
    return Compilation(
        titles=("ST THOMAS USVI  POINTS OF THE RUN AND OF THE BOTTOM  SIMULATED",),
        models=models(*MODELS),
        stages=pointed(rows, 22, pointing),
        profiles=ProfileSpecs(
            ids=np.array([name for name, *_ in PROFILES]),
            model=np.array([number for _, number, *_ in PROFILES]),
            start=np.array([start for _, _, (start, _), _ in PROFILES]),
            end=np.array([end for _, _, (_, end), _ in PROFILES]),
            step=np.full(len(PROFILES), 50.0),
            spacing=np.full(len(PROFILES), 50.0),
            spike=np.full(len(PROFILES), 2.0),
            tolerance=np.full(len(PROFILES), 0.3),
        ),
        grids=GridSpecs(
            ids=np.array(["BAY"]),
            collocated=np.array([False]),
            spacing=np.array([100.0]),
            first=np.array([[18.327, -64.941]]),
            second=np.array([[18.3335, -64.919]]),
        ),
        datum=SoundingDatum(name="MLLW", height=-0.15, sigma=0.05),
        contours=ContourSpec(interval=2.0, index=5, longest_edge=600.0, shortest=20.0),
    )


def cayman() -> Compilation:
    """Return the deck of Cayman: points of the run on frames 842 and 843, of Table 6-9 among them, read again."""
    block = read_deck(FIXTURES / "cayman" / "cayman_clean.crd")
    return Compilation(
        titles=("GRAND CAYMAN  POINTS OF TABLE 6-9  SIMULATED",),
        models=models(("842843", "842", "843")),
        stages=pointed(read_again(block, 0, "842", "843"), 69),
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
    CAYMAN.parent.mkdir(exist_ok=True)
    DECK.write_bytes(compilation_bytes(compilation()))
    CAYMAN.write_bytes(compilation_bytes(cayman()))
    SOUNDINGS.write_text(soundings())
    CONTOURS.write_text(contours())
