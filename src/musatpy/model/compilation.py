"""A compilation deck: stereomodels of a run, and what was read in them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.tables import Table, empty, per_job, per_row

IN_PROFILE = "P"  # class of readings of a profile
SHORE = "S"  # class of readings of the shoreline
AGAIN = "R"  # class of points of the run that are read again
RECOVERABLE = 0.015  # mm, "recoverable to within 10-15 microns" (ETL-0306, section 6)


class Mode(StrEnum):
    """How true coordinates are found."""

    IMAGE = "IMAGE"
    PRINTED = "PRINTED"


@dataclass(frozen=True, kw_only=True, eq=False)
class StereomodelSpecs(Table):
    """m stereomodels, in the order of the deck; empty texts and NaN stand for what a card leaves open."""

    ids: TextArray = per_row()  # (m,)
    left: TextArray = per_row()  # (m,) photo ids
    right: TextArray = per_row()
    mode: TextArray = per_row(blank="")  # (m,) IMAGE, PRINTED
    vertical: TextArray = per_row(blank="")  # (m,) POINT, MODEL
    tide: TextArray = per_row(blank="")  # (m,) PHOTO, MEAN
    rays: TextArray = per_row(blank="")  # (m,) OWN, SHARED
    pointing: FloatArray = per_row(unit="mm", blank=np.nan)  # (m,)
    limit: FloatArray = per_row(unit="mm", blank=np.nan)  # (m,)
    # (m,) the mark of the plotter was the true point, not where straight rays meet
    true_marks: BoolArray = per_row(blank=False, codes={"A": False, "": False, "T": True})


@dataclass(frozen=True, kw_only=True, eq=False)
class StageReadings(Table):
    """k points read in a model, in the order of the deck: on its stages, or as model points (`place` is known)."""

    model: IntArray = per_row(link="models")  # (k,)
    ids: TextArray = per_row()  # (k,)
    kind: TextArray = per_row(codes={"": "G", "G": "G", "P": "P", "S": "S", "R": "R"})  # (k,)
    submerged: BoolArray = per_row(codes={"": False, "B": True})  # (k,)
    # (k, 2, 2) left and right, x and y; NaN of model points
    xy: FloatArray = per_row(2, 2, unit="mm", blank=np.nan)
    sigma: FloatArray = per_row(unit="mm", blank=np.nan)  # (k,) NaN: the pointing of the model
    # (k, 3) in the model, of the mark; NaN of readings on the stages
    place: FloatArray = per_row(3, unit="m", blank=np.nan)
    # (k,) of the right image less the left, along Y of the model; NaN: not read
    parallax: FloatArray = per_row(unit="mm", blank=np.nan)
    time: FloatArray = per_row(unit="s", blank=np.nan)  # (k,) of readings of profiles; NaN: not known

    def of_model(self, row: int) -> IntArray:
        """Return the rows of the readings in a model."""
        return np.flatnonzero(self.model == row)

    @property
    def as_points(self) -> BoolArray:
        """(k,) read as model points."""
        return np.asarray(np.isfinite(self.place).all(axis=1))

    @property
    def without_parallax(self) -> BoolArray:
        """(k,) model points whose y-parallax was not read."""
        return self.as_points & np.isnan(self.parallax)


@dataclass(frozen=True, kw_only=True, eq=False)
class ProfileSpecs(Table):
    """q profiles of models, in the order of the deck; lengths in m.

    A line runs from its start to its end. A scan along X or Y of the model covers the rectangle between them by
    lines.
    """

    ids: TextArray = per_row()  # (q,)
    model: IntArray = per_row(link="models")  # (q,)
    start: TextArray = per_row()  # (q,) ids of readings; empty: `places` has the ends
    end: TextArray = per_row()
    places: FloatArray = per_row(2, 2, blank=np.nan)  # (q, 2, 2) start and end, NaN where points are
    # (q,) of these: M model, J job (degrees, or m); empty where points are
    system: TextArray = per_row(blank="", codes={"": "M", "M": "M", "J": "J"})
    step: FloatArray = per_row(unit="m")  # (q,)
    spike: FloatArray = per_row(unit="m", blank=np.nan)  # (q,) NaN: nothing is a spike
    tolerance: FloatArray = per_row(unit="m", blank=0.0)  # (q,) 0: all readings are needed
    # (q,) L one line, X, Y lines along this axis of the model
    scan: TextArray = per_row(blank="L", codes={"L": "L", "": "L", "X": "X", "Y": "Y"})
    spacing: FloatArray = per_row(unit="m", blank=np.nan)  # (q,) of the lines of a scan


@dataclass(frozen=True, kw_only=True, eq=False)
class GridSpecs(Table):
    """g grids of posts, in the order of the deck."""

    ids: TextArray = per_row()  # (g,)
    # (g,) predicted by collocation, not read off the triangles
    collocated: BoolArray = per_row(codes={"T": False, "": False, "C": True})
    spacing: FloatArray = per_row(unit="m")  # (g,)
    first: FloatArray = per_row(2)  # (g, 2) corner, degrees or m as the job's coordinates; NaN: all of the bottom
    second: FloatArray = per_row(2)  # (g, 2) opposite corner


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


@dataclass(frozen=True, kw_only=True)
class SoundingDatum:
    """The height from which charted depths count, in heights of the job (m), and its sigma, 0 where it is exact.

    With a `geoid`, the grid file of PROJ for a surface over the ellipsoid, it is the height above that.
    """

    name: str = ""
    height: float = per_job(0.0, unit="m")
    sigma: float = per_job(0.0, unit="m")
    geoid: str = ""


@dataclass(frozen=True, kw_only=True)
class ContourSpec:
    """Contours at multiples of an interval (m), every so many drawn thick, and at levels that are listed.

    They are those of triangles with limited edges, or of the posts of a `grid`.
    """

    interval: float = per_job(math.nan, unit="m")  # NaN: those that are listed only
    index: int = 5
    longest_edge: float = per_job(math.inf, unit="m")
    shortest: float = per_job(0.0, unit="m")  # pieces shorter than this are left out
    drying: float = per_job(
        math.nan, unit="m"
    )  # above the datum, up to which dry points belong to the bottom; NaN: none do
    grid: str = ""
    listed: tuple[float, ...] = per_job((), unit="m")
    listed_index: tuple[float, ...] = ()  # those that are drawn thick


@dataclass(frozen=True, kw_only=True, eq=False)
class CardLines:
    """The lines of a deck on which its models, readings, profiles and grids stand, row by row."""

    models: IntArray
    stages: IntArray
    profiles: IntArray
    grids: IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Compilation:
    """What a compilation deck says."""

    titles: tuple[str, ...]
    models: StereomodelSpecs
    stages: StageReadings
    profiles: ProfileSpecs = field(default_factory=partial(empty, ProfileSpecs))
    grids: GridSpecs = field(default_factory=partial(empty, GridSpecs))
    datum: SoundingDatum | None = None  # None: no card
    contours: ContourSpec | None = None  # of depth below the datum; None: none are asked for
    heights: ContourSpec | None = None  # contours of height
    lines: CardLines | None = None  # None: of no file


CARD_TABLES: dict[str, type] = {  # what cards fill, by the first word of their targets
    "models": StereomodelSpecs,
    "stages": StageReadings,
    "profiles": ProfileSpecs,
    "grids": GridSpecs,
    "datum": SoundingDatum,
    "contours": ContourCards,
    "contour_levels": ContourLevels,
    "profile_times": ProfileTimes,
}
