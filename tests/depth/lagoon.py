"""The survey of fixtures/lagoon, made without the package: images of known points, and where they seem to meet.

`python tests/depth/lagoon.py` writes the files anew. Rays are found by bracketing their angle, apparent points by
scipy's least squares of the image residuals.
"""

import csv
import math
from pathlib import Path

import numpy as np
from scipy.optimize import brentq, least_squares

from musatpy.correction.photographs import ByPhotographs, Photographs
from musatpy.depth.cameras import CameraStations, read_cameras

FOLDER = Path(__file__).parents[2] / "fixtures" / "lagoon"
INDEX, FOCAL, FORMAT = 1.3398, 152.4, 228.6
HEIGHT, BASE, INTERVAL = 900.0, 540.0, 900.0  # 60 % forward, 33 % side overlap
MARGIN = 1.0  # mm within or beyond the format: no rounding changes who sees a point


def rotation(omega: float, phi: float, kappa: float) -> np.ndarray:
    """M = R3 R2 R1 of angles in degrees, written as three turns."""
    (so, co), (sp, cp), (sk, ck) = (
        (math.sin(math.radians(a)), math.cos(math.radians(a))) for a in (omega, phi, kappa)
    )
    first = np.array([[1, 0, 0], [0, co, so], [0, -so, co]])
    second = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    third = np.array([[ck, sk, 0], [-sk, ck, 0], [0, 0, 1]])
    return third @ second @ first


def stations() -> list[tuple[str, list[float]]]:
    """Names, and x, y, z, tide, omega, phi, kappa as they are printed: two strips of four, flown to and fro."""
    rng = np.random.default_rng(1964)
    rows = []
    for strip in (0, 1):
        for photo in range(4):
            x, y, z = np.array([photo * BASE, strip * INTERVAL, HEIGHT]) + rng.normal(0.0, 8.0, 3)
            tilt = rng.normal(0.0, 1.2, 2)
            heading = 180.0 * strip + rng.normal(0.0, 2.0)
            tide = 0.35 - 0.02 * photo - 0.25 * strip  # the tide falls while the second strip is flown
            numbers = [round(float(v), 3) for v in (x, y, z, tide)]
            rows.append((f"{strip + 1}{photo + 1:02d}", numbers + [round(float(v), 4) for v in (*tilt, heading)]))
    return rows


def true_points() -> list[tuple[str, np.ndarray]]:
    """A lagoon floor that deepens to 18 m, a rock above water, one awash, and points at the edge and off it."""
    rng = np.random.default_rng(14)
    rows = []
    for i in range(72):
        x, y = rng.uniform(-250.0, 3.0 * BASE + 250.0), rng.uniform(-450.0, INTERVAL + 450.0)
        depth = 1.0 + 17.0 * (0.5 + 0.5 * math.sin(x / 400.0) * math.cos(y / 300.0)) * rng.uniform(0.9, 1.0)
        rows.append((f"S{i + 1:02d}", np.array([x, y, -depth])))
    rows += [
        ("ROCK", np.array([700.0, 300.0, 2.6])),
        ("AWASH", np.array([800.0, 450.0, 0.2])),
        ("OFF", np.array([9000.0, 300.0, -5.0])),
    ]
    return [(name, place.round(3)) for name, place in rows]


def image(camera: list[float], place: np.ndarray) -> np.ndarray:
    """Image coordinates (mm) of a place under water, or of one above it by a straight ray."""
    x, y, z, tide, *angles = camera
    gap = place - np.array([x, y, z])
    D, H, h = float(np.hypot(gap[0], gap[1])), z - tide, tide - place[2]
    if h > 0.0 and D > 0.0:
        reach = brentq(
            lambda i: H * math.tan(i) + h * math.tan(math.asin(math.sin(i) / INDEX)) - D, 0.0, 1.5, xtol=1e-15
        )
        gap = np.array([*(gap[:2] / D * math.tan(reach)), -1.0])
    u, v, w = rotation(*angles) @ gap
    return np.array([-FOCAL * u / w, -FOCAL * v / w])


def straight(camera: list[float], place: np.ndarray) -> np.ndarray:
    u, v, w = rotation(*camera[4:]) @ (place - np.array(camera[:3]))
    return np.array([-FOCAL * u / w, -FOCAL * v / w])


def survey() -> list[tuple[str, np.ndarray, np.ndarray | None, list[str]]]:
    """Name, true and apparent place of each point and the photos on which it is; without those near a border."""
    cameras, found = stations(), []
    for name, place in true_points():
        images = [(photo, camera, image(camera, place)) for photo, camera in cameras]
        border = [FORMAT / 2 - float(np.abs(xy).max()) for *_, xy in images]
        if min(map(abs, border)) < MARGIN:
            continue
        rays = [ray for ray, inside in zip(images, border, strict=True) if inside > 0.0]
        apparent = place * [1.0, 1.0, 1 / 1.4 if place[2] < 0.0 else 1.0]
        if len(rays) > 1:

            def residuals(at: np.ndarray, rays: list = rays) -> np.ndarray:
                return np.concatenate([straight(camera, at) - xy for _, camera, xy in rays])

            apparent = least_squares(residuals, apparent, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        found.append((name, place, apparent, [photo for photo, *_ in rays]))
    return found


def files() -> dict[str, str]:
    """The files of the fixture by name."""
    cameras = ["name,x,y,z,tide,omega,phi,kappa"]
    cameras += [f"{name},{','.join(f'{v:.4f}' for v in numbers)}" for name, numbers in stations()]
    points, truth = ["point,x,y,z"], ["point,x,y,z,photos"]
    for name, place, apparent, photos in survey():
        points.append(f"{name},{','.join(f'{v:.4f}' for v in apparent)}")
        truth.append(f"{name},{','.join(f'{v:.3f}' for v in place)},{' '.join(photos)}")
    named = {"cameras.csv": cameras, "points.csv": points, "truth.csv": truth}
    return {name: "\n".join(lines) + "\n" for name, lines in named.items()}


def by_photographs(cameras: CameraStations | None = None, index: float = INDEX) -> ByPhotographs:
    """Return what corrects points by cameras, those of the lagoon where none are given."""
    seen_by = cameras or read_cameras(FOLDER / "cameras.csv", camera=(FOCAL, FORMAT, FORMAT))
    photographs = Photographs(cameras=seen_by, errors=None)
    return ByPhotographs(system=seen_by.system, photographs=photographs, index=index)


def rows(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, by the names of their columns."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def main() -> None:
    for name, text in files().items():
        (FOLDER / name).write_text(text)


if __name__ == "__main__":
    main()
