"""The table and the picture of the study of docs/waves_from_stereo.md: `python -m drivers.sea_tables` computes it.

Pictures need the extra `plots`. It takes some minutes.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from studies.stereo import Outcome, Setup, run

ROOT = Path(__file__).parents[2]
TABLE = ROOT / "docs" / "studies" / "waves_from_stereo.csv"
PICTURE = ROOT / "docs" / "pictures" / "waves_from_stereo.png"
HEAD = (
    "varied,sea,value,spacing,level_plan,level_height,true_plan,true_height,waves_plan,waves_height,grid_plan,grid_height,"
    "surface_level,surface_waves,surface_grid,waves_found,grid_cover,honesty_waves,honesty_grid"
)

SEEDS = (1, 2, 3)
SEAS = {
    "swell of 92 m": {"periods": (10.0,), "deep_heights": (1.0,), "azimuths": (30.0,)},
    "chop of 25 m": {"periods": (4.0,), "deep_heights": (0.3,), "azimuths": (70.0,)},
    "both": {"periods": (10.0, 4.0), "deep_heights": (1.0, 0.3), "azimuths": (30.0, 70.0)},
}
COUNTS = (25, 50, 100, 200, 400, 800)
NOISE = (1.0, 2.0, 5.0, 10.0, 20.0)
PERIODS = (3.0, 4.0, 6.0, 8.0, 10.0, 15.0)
POINTS_PER_LENGTH = (1.5, 1.9, 2.2, 3.0, 4.0)  # of the chop, on a regular grid


def by_number() -> dict[str, list[Outcome]]:
    return {
        name: [run(Setup(surface_points=count, **keys), SEEDS) for count in COUNTS] for name, keys in SEAS.items()
    }


def by_noise() -> list[Outcome]:
    return [run(Setup(image_sigma=noise, **SEAS["both"]), SEEDS) for noise in NOISE]


def by_period() -> list[Outcome]:
    return [run(Setup(periods=(period,), deep_heights=(0.3,)), SEEDS) for period in PERIODS]


def by_sampling() -> list[Outcome]:
    chop = Setup(**SEAS["chop of 25 m"], regular=True, area=(200.0, 300.0))
    length = float(2.0 * np.pi / np.linalg.norm(chop.waves.vector[0]))
    counts = [round(np.prod(chop.area) * (part / length) ** 2) for part in POINTS_PER_LENGTH]
    return [run(replace(chop, surface_points=count), SEEDS) for count in counts]


def table(numbers: dict[str, list[Outcome]]) -> str:
    """Return the table as CSV, one line per outcome."""
    rows = [row("points", sea, one.setup.surface_points, one) for sea, series in numbers.items() for one in series]
    rows += [row("noise", "both", noise, one) for noise, one in zip(NOISE, by_noise(), strict=True)]
    rows += [row("period", "one wave", period, one) for period, one in zip(PERIODS, by_period(), strict=True)]
    sampled = zip(POINTS_PER_LENGTH, by_sampling(), strict=True)
    rows += [row("points to L", "chop of 25 m", part, one) for part, one in sampled]
    return "\n".join([HEAD, *rows]) + "\n"


def row(varied: str, sea: str, value: float, one: Outcome) -> str:
    rms = [one.rms[method] for method in ("level", "true", "fourier", "grid")]
    plan_and_height = [size for x, y, z in rms for size in (np.hypot(x, y), z)]
    surface = [one.wave[name][2] for name in ("level", "fourier", "grid")]
    cells = [
        varied,
        sea,
        f"{value:g}",
        f"{one.spacing:.1f}",
        *(f"{size:.3f}" for size in (*plan_and_height, *surface)),
    ]
    cells += [f"{one.waves:.1f}", f"{one.covered['grid']:.2f}"]
    return ",".join([*cells, *(f"{one.honesty[method]:.2f}" for method in ("fourier", "grid"))])


def picture(numbers: dict[str, list[Outcome]]) -> bytes:
    from studies.pictures import stereo_picture

    return stereo_picture(list(numbers.items()))


if __name__ == "__main__":
    found = by_number()
    PICTURE.write_bytes(picture(found))
    TABLE.write_text(table(found), encoding="utf-8")
