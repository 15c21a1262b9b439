"""The pair of fixtures/sea, simulated: `python tests/sea_fixtures.py` writes its files anew."""

from pathlib import Path

import numpy as np

from musatpy.geometry.collinearity import nearest_point
from musatpy.sea.stereo.surface_points import intersection_covariance
from studies.stereo import Setup, Simulation, simulate

SEA = Path(__file__).parents[1] / "fixtures" / "sea"
SETUP = Setup(
    periods=(10.0, 4.0),
    deep_heights=(1.0, 0.3),
    azimuths=(30.0, 70.0),
    surface_points=400,
    bottom_points=40,
    seed=7,
)
SHIFT = np.array([5000.0, 3000.0, 0.0])  # coordinates of a job do not begin at its pair
GROSS = {17: 1.2, 230: -0.9}  # m, row of a surface point -> error of matching


def simulation() -> Simulation:
    return simulate(SETUP)


def apparent(pair: Simulation) -> np.ndarray:
    """Return the bottom intersected in air (n, 3) m."""
    return nearest_point(np.broadcast_to(SETUP.cameras, pair.rays.shape), pair.rays)


def files() -> dict[str, str]:
    pair = simulation()
    water = pair.surface_points.position + SHIFT
    water[list(GROSS), 2] += list(GROSS.values())
    sigma = np.sqrt(np.diagonal(pair.surface_points.covariance, axis1=1, axis2=2))
    seen = apparent(pair)
    seen_sigma = np.sqrt(np.diagonal(intersection_covariance(SETUP.cameras, seen, SETUP.angle), axis1=1, axis2=2))
    names = [f"B{i + 1}" for i in range(len(seen))]
    return {
        "cameras.csv": _csv("name,x,y,z", ["L", "R"], SETUP.cameras + SHIFT),
        "water.csv": _csv("id,x,y,z,sx,sy,sz", pair.surface_points.ids, np.column_stack([water, sigma])),
        "bottom.csv": _csv("id,x,y,z,sx,sy,sz", names, np.column_stack([seen + SHIFT, seen_sigma])),
        "truth.csv": _csv("id,x,y,z", names, pair.bottom + SHIFT),
    }


def _csv(header: str, names, values: np.ndarray) -> str:
    rows = [",".join([name, *(f"{value:.4f}" for value in row)]) for name, row in zip(names, values, strict=True)]
    return "\n".join([header, *rows]) + "\n"


if __name__ == "__main__":
    SEA.mkdir(exist_ok=True)
    for name, text in files().items():
        (SEA / name).write_text(text)
