"""The strip of fixtures/waves, photographed through two waves; `python tests/wave_strip.py` writes it anew.

Images are traced by `reference.waves`, which knows nothing of the program's refraction or of its cards: the
waves are set up here from the words of the cards and the dispersion relation.
"""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from musatpy import model
from musatpy.formats import musat
from musatpy.model import Block, CoordinateSystem
from musatpy.model.block import in_order
from musatpy.model.tables import taken
from musatpy.model.water import WAVE_SIGMAS
from musatpy.refraction.waves import Harmonic, sinusoidal
from musatpy.units import DEGREE
from reference import wave_scenes, waves
from reference.networks import Plan

FOLDER = Path(__file__).parents[1] / "fixtures" / "waves"
PERIOD, DEPTH = 10.0, 12.0  # s, m of the swell, whose length is for theory to find
CHOP_LENGTH, CHOP_SPEED = 24.7, 6.17  # m, m/s
HEIGHT, AZIMUTH, CREST = (1.1, 0.3), (60.0, 115.0), (12.5, -4.0)  # m, degrees clockwise from north, m
INTERVAL = 12.5  # s between exposures
NOISE = 0.003  # mm


def swell_length() -> float:
    """Return the length (m) at which w^2 = g k tanh kh."""
    return wave_scenes.length_of(PERIOD, DEPTH)


def true_waves() -> Harmonic:
    """Return the waves in the words of `sinusoidal`: azimuths from east towards north."""
    length = np.array([swell_length(), CHOP_LENGTH])
    speed = np.array([swell_length() / PERIOD, CHOP_SPEED])
    azimuth = np.pi / 2.0 - np.array(AZIMUTH) * DEGREE
    return sinusoidal(amplitude=np.array(HEIGHT) / 2.0, length=length, azimuth=azimuth, speed=speed, crest=CREST)


def wave_cards() -> model.Waves:
    """Return the waves as cards say them: the swell by its period, the chop by length and speed."""
    unknown = np.full(2, np.nan)
    return model.Waves(
        ids=["SW", "CHOP"],
        shape=["SINU", ""],
        period=[PERIOD, np.nan],
        depth=[DEPTH, np.nan],
        length=[np.nan, CHOP_LENGTH],
        speed=[np.nan, CHOP_SPEED],
        height=HEIGHT,
        azimuth=np.array(AZIMUTH) * DEGREE,
        crest=CREST,
        **dict.fromkeys(WAVE_SIGMAS, unknown),
    )


@lru_cache
def strip(system: CoordinateSystem, noise: float = 0.0) -> tuple[Block, np.ndarray]:
    """Return the block with its wave cards, plate coordinates with a noise (mm), and the true points (p, 3)."""
    plan = Plan(
        system=system, submerged=True, sea_control=True, photos_per_strip=4, height=1500.0, base=650.0, noise=0.0,
        plate_sigma=0.003, start_error=(2.0, 1e-3), control_errors=False, seed=5,
    )  # fmt: skip
    block, time, origin, truth = waves.photographed(plan, true_waves(), INTERVAL)
    xy = block.plates.xy + np.random.default_rng(7).normal(0.0, 1.0, block.plates.xy.shape) * noise
    measured = np.bincount(block.plates.point, minlength=len(truth)) > 0
    ids = block.points.ids
    block = in_order(
        replace(
            block,
            titles=("STRIP THROUGH WAVES", "SIMULATED  SEE FIXTURES/WAVES/README.MD"),
            options=model.Options(
                system=system,
                program=model.Program.IIIA,
                refraction=model.Refraction.RIGOROUS,
                plate_sigma=NOISE,
            ),
            photos=replace(block.photos, time=time),
            plates=replace(block.plates, xy=xy),
            control=taken(block.control, measured[block.control.point]),
            waves=wave_cards(),
            wave_origin=model.WaveOrigin(position=tuple(origin.tolist())),
        )
    )
    rows = {name: row for row, name in enumerate(ids.tolist())}
    return block, truth[[rows[name] for name in block.points.ids.tolist()]]


def truth_text(block: Block, truth: np.ndarray) -> str:
    """Return the true points as comma separated values."""
    lines = (
        f"{name},{x / DEGREE:.11f},{y / DEGREE:.11f},{z:.5f}"
        for name, (x, y, z) in zip(block.points.ids, truth, strict=True)
    )
    return "\n".join(["point,latitude_deg,longitude_deg,height_m", *lines]) + "\n"


if __name__ == "__main__":
    made, true = strip(CoordinateSystem.GEOGRAPHIC, NOISE)
    musat.write_deck(made, FOLDER / "strip.crd")
    (FOLDER / "strip.truth.csv").write_text(truth_text(made, true))
