"""The waves on the water of a job, as their cards say them, and the place from which their crests count."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.model.arrays import freeze


class WaveShape(StrEnum):
    """Shapes of a wave."""

    SINUSOIDAL = "SINU"
    STOKES = "STOK"
    TROCHOIDAL = "TROC"


@dataclass(frozen=True, kw_only=True, eq=False)
class Waves:
    """k trains of waves, added up on the tide of each photo; what is not given is NaN.

    Period, or length, or two of period, length and speed: linear theory knows the rest (`musatpy.sea.trains`).
    Azimuths count clockwise from true north (+Y of local jobs), crests from the `WaveOrigin`. A parameter is known
    where its sigma is NaN.
    """

    ids: TextArray  # (k,)
    shape: TextArray  # (k,) of WaveShape; empty is the first
    period: FloatArray  # (k,) s
    depth: FloatArray  # (k,) m of the water, for theory; NaN: deep
    length: FloatArray  # (k,) m
    speed: FloatArray  # (k,) m/s of the crests
    height: FloatArray  # (k,) m from trough to crest
    azimuth: FloatArray  # (k,) rad, of the direction the wave runs to
    crest: FloatArray  # (k,) m in that direction from the origin to a crest, at time 0
    height_sigma: FloatArray  # (k,) m
    length_sigma: FloatArray  # (k,) m
    azimuth_sigma: FloatArray  # (k,) rad
    crest_sigma: FloatArray  # (k,) m

    def __post_init__(self) -> None:
        freeze(self, "ids", str, -1)
        n = len(self.ids)
        freeze(self, "shape", str, n)
        for name in (*PARAMETERS, *SIGMAS):
            freeze(self, name, float, n)

    @property
    def unknown(self) -> BoolArray:
        """(k,) some parameter of the wave is unknown: it has a sigma."""
        return np.asarray(np.isfinite([getattr(self, name) for name in SIGMAS]).any(axis=0))


PARAMETERS = ("period", "depth", "length", "speed", "height", "azimuth", "crest")
SIGMAS = ("height_sigma", "length_sigma", "azimuth_sigma", "crest_sigma")


def known_waves(waves: Waves) -> Waves:
    """Return the waves without sigmas."""
    return replace(waves, **dict.fromkeys(SIGMAS, np.full(len(waves.ids), np.nan)))


@dataclass(frozen=True, kw_only=True)
class WaveOrigin:
    """Where the surface of the waves has its x = y = 0, in the coordinate system of the job."""

    position: tuple[float, float, float]


def no_waves() -> Waves:
    """Return the waves of a job that has none."""
    none, nobody = np.zeros(0), np.zeros(0, dtype=np.str_)
    return Waves(ids=nobody, shape=nobody, **dict.fromkeys((*PARAMETERS, *SIGMAS), none))
