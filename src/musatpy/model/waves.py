"""The waves on the water of a job, as their cards say them, and the place from which their crests count."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.model.tables import Table, per_row


class WaveShape(StrEnum):
    """Shapes of a wave."""

    SINUSOIDAL = "SINU"
    STOKES = "STOK"
    TROCHOIDAL = "TROC"


@dataclass(frozen=True, kw_only=True, eq=False)
class Waves(Table):
    """k trains of waves, added up on the tide of each photo; what is not given is NaN.

    Period, or length, or two of period, length and speed: linear theory knows the rest (`musatpy.sea.deck_waves`).
    Azimuths count clockwise from true north (+Y of local jobs), crests from the `WaveOrigin`. A parameter is known
    where its sigma is NaN.
    """

    ids: TextArray = per_row(identity=True)  # (k,)
    shape: TextArray = per_row(role="waves")  # (k,) of WaveShape; empty is the first
    period: FloatArray = per_row(role="waves", unit="s")  # (k,)
    depth: FloatArray = per_row(role="waves", unit="m")  # (k,) of the water, for theory; NaN: deep
    length: FloatArray = per_row(role="waves", unit="m")  # (k,)
    speed: FloatArray = per_row(role="waves", unit="m/s")  # (k,) of the crests
    height: FloatArray = per_row(role="waves", unit="m")  # (k,) from trough to crest
    azimuth: FloatArray = per_row(role="waves", unit="rad")  # (k,) of the direction the wave runs to
    crest: FloatArray = per_row(role="waves", unit="m")  # (k,) that way from the origin to a crest, at time 0
    height_sigma: FloatArray = per_row(role="wave_sigmas", unit="m")  # (k,)
    length_sigma: FloatArray = per_row(role="wave_sigmas", unit="m")  # (k,)
    azimuth_sigma: FloatArray = per_row(role="wave_sigmas", unit="rad")  # (k,)
    crest_sigma: FloatArray = per_row(role="wave_sigmas", unit="m")  # (k,)

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
