"""The tables that the cards of a compilation deck fill: those of the model, and cards that are no rows of them."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.model import compilation
from musatpy.model.tables import Table, per_row

_KINDS = {"D": "D", "": "D", "H": "H"}


@dataclass(frozen=True, kw_only=True, eq=False)
class ContourCards(Table):
    """What k CIN cards say; NaN for a blank."""

    of: TextArray = per_row(codes=_KINDS)  # D of depth, H of height
    interval: FloatArray = per_row(unit="m")
    index: FloatArray
    longest_edge: FloatArray = per_row(unit="m")
    shortest: FloatArray = per_row(unit="m")
    drying: FloatArray = per_row(unit="m")
    grid: TextArray


@dataclass(frozen=True, kw_only=True, eq=False)
class ContourLevels(Table):
    """What k CIL cards say: levels, NaN for a blank."""

    of: TextArray = per_row(codes=_KINDS)
    thick: BoolArray = per_row(codes={"": False, "I": True})
    levels: FloatArray = per_row(8, unit="m")


@dataclass(frozen=True, kw_only=True, eq=False)
class ProfileTimes(Table):
    """What k PTM cards say: times of readings of a profile from the reading `first` on, which count from 1."""

    model: TextArray
    ids: TextArray
    first: FloatArray
    time: FloatArray = per_row(5, unit="s")


TABLES: dict[str, type] = {
    "models": compilation.StereomodelSpecs,
    "stages": compilation.StageReadings,
    "profiles": compilation.ProfileSpecs,
    "grids": compilation.GridSpecs,
    "datum": compilation.SoundingDatum,
    "contours": ContourCards,
    "contour_levels": ContourLevels,
    "profile_times": ProfileTimes,
}
