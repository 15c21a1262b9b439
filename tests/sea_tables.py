"""The tables and the picture of docs/waves_from_stereo.md: `python tests/sea_tables.py` computes them anew.

Pictures need the extra `plots`. It takes some minutes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from studies.stereo import Outcome, Setup, run

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "waves_from_stereo.md"
PICTURE = ROOT / "docs" / "pictures" / "waves_from_stereo.png"
BEGIN, END = "<!-- study: begin -->", "<!-- study: end -->"

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


def text(numbers: dict[str, list[Outcome]]) -> str:
    lines = ["### Number of surface points", ""]
    for name, outcomes in numbers.items():
        lines += [f"{name[0].upper()}{name[1:]}:", ""]
        lines += [*table("points", [str(one.setup.surface_points) for one in outcomes], outcomes), ""]
    lines += ["### Image noise", "", "Both waves, 400 surface points:", ""]
    lines += [*table("noise, um", [f"{noise:g}" for noise in NOISE], by_noise()), ""]
    periods = by_period()
    lengths = [2.0 * np.pi / np.linalg.norm(one.setup.waves.vector[0]) for one in periods]
    heads = [f"{period:g} s, {length:.0f} m" for period, length in zip(PERIODS, lengths, strict=True)]
    lines += ["### Period", "", "One wave, 0.3 m high in deep water, 400 surface points:", ""]
    lines += [*table("period, length", heads, periods), ""]
    lines += ["### A regular grid of points", "", "The chop over 200 by 300 m, by points to a wave length:", ""]
    return "\n".join([*lines, *table("points to L", [f"{part:g}" for part in POINTS_PER_LENGTH], by_sampling())])


def table(name: str, heads: Sequence[str], outcomes: Sequence[Outcome]) -> list[str]:
    """Return a table in Markdown, one line per outcome."""
    return [
        f"| {name} | spacing | level | true | waves | grid | level | waves | grid | found | cover | honesty |",
        "|---|---:|---|---|---|---|---:|---:|---:|---:|---:|---|",
        *(row(head, one) for head, one in zip(heads, outcomes, strict=True)),
    ]


def row(head: str, one: Outcome) -> str:
    def plan_and_height(method: str) -> str:
        x, y, z = one.rms[method]
        return f"{np.hypot(x, y):.3f} {z:.3f}"

    cells = [head, f"{one.spacing:.1f}", *(plan_and_height(name) for name in ("level", "true", "fourier", "grid"))]
    cells += [f"{one.wave[name][2]:.3f}" for name in ("level", "fourier", "grid")]
    cells += [f"{one.waves:.1f}", f"{one.covered['grid']:.2f}"]
    cells += [f"{one.honesty['fourier']:.2f} {one.honesty['grid']:.2f}"]
    return f"| {' | '.join(cells)} |"


def picture(numbers: dict[str, list[Outcome]]) -> bytes:
    from studies.pictures import stereo_picture

    return stereo_picture(list(numbers.items()))


def with_tables(page: str, tables: str) -> str:
    """Return the page with the text between its marks made anew."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n\n{tables}\n\n{END}{after}"


if __name__ == "__main__":
    found = by_number()
    PICTURE.write_bytes(picture(found))
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8"), text(found)), encoding="utf-8")
