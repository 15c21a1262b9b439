"""A compilation deck: stereomodels of a run, and what was read in them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from typing import Any

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model.block import Block
from musatpy.model.tables import Table, empty, per_row

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
    mode: TextArray = per_row()  # (m,) IMAGE, PRINTED
    vertical: TextArray = per_row()  # (m,) POINT, MODEL
    tide: TextArray = per_row()  # (m,) PHOTO, MEAN
    rays: TextArray = per_row()  # (m,) OWN, SHARED
    pointing: FloatArray = per_row()  # (m,) mm
    limit: FloatArray = per_row()  # (m,) mm
    adjust: BoolArray = per_row()  # (m,) the right stage is corrected by points read again
    true_marks: BoolArray = (
        per_row()
    )  # (m,) the mark of the plotter was the true point, not where straight rays meet

    @classmethod
    def of_photos(cls, ids: TextArray, left: TextArray, right: TextArray, pointing: float) -> StereomodelSpecs:
        """Return models of photos with a pointing (mm) and all else left open."""
        blank, none = np.full(len(ids), ""), np.full(len(ids), np.nan)
        return cls(
            ids=ids,
            left=left,
            right=right,
            mode=blank,
            vertical=blank,
            tide=blank,
            rays=blank,
            pointing=np.full(len(ids), pointing),
            limit=none,
            adjust=np.zeros(len(ids), dtype=bool),
            true_marks=np.zeros(len(ids), dtype=bool),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class StageReadings(Table):
    """k points read in a model, in the order of the deck: on its stages, or as model points (`place` is known)."""

    model: IntArray = per_row()  # (k,) link to the models
    ids: TextArray = per_row()  # (k,)
    kind: TextArray = per_row()  # (k,) G, P, S, R
    submerged: BoolArray = per_row()  # (k,)
    xy: FloatArray = per_row(2, 2)  # (k, 2, 2) mm, left and right, x and y; NaN of model points
    sigma: FloatArray = per_row()  # (k,) mm, NaN: the pointing of the model
    place: FloatArray = per_row(3)  # (k, 3) m in the model, of the mark; NaN of readings on the stages
    parallax: FloatArray = (
        per_row()
    )  # (k,) mm, of the right image less the left, along Y of the model; NaN: not read

    @classmethod
    def on_stages(cls, **columns: Any) -> StageReadings:
        """Return readings on the stages from the other columns."""
        count = len(columns["ids"])
        return cls(**columns, place=np.full((count, 3), np.nan), parallax=np.full(count, np.nan))

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
    """q profiles between points of a model, in the order of the deck; lengths in m."""

    ids: TextArray = per_row()  # (q,)
    model: IntArray = per_row()  # (q,) link to the models
    start: TextArray = per_row()  # (q,) ids of readings
    end: TextArray = per_row()
    step: FloatArray = per_row()  # (q,)
    spike: FloatArray = per_row()  # (q,) NaN: nothing is a spike
    tolerance: FloatArray = per_row()  # (q,) 0: all readings are needed


@dataclass(frozen=True, kw_only=True, eq=False)
class GridSpecs(Table):
    """g grids of posts, in the order of the deck."""

    ids: TextArray = per_row()  # (g,)
    collocated: BoolArray = per_row()  # (g,) predicted by collocation, not read off the triangles
    spacing: FloatArray = per_row()  # (g,) m
    first: FloatArray = per_row(2)  # (g, 2) corner, degrees or m as the job's coordinates; NaN: all of the bottom
    second: FloatArray = per_row(2)  # (g, 2) opposite corner


@dataclass(frozen=True, kw_only=True)
class SoundingDatum:
    """The height from which charted depths count, in heights of the job (m), and its sigma, 0 where it is exact."""

    name: str = ""
    height: float = 0.0
    sigma: float = 0.0


@dataclass(frozen=True, kw_only=True)
class ContourSpec:
    """Contours of depth at multiples of an interval, every so many drawn thick, over triangles of limited edges."""

    interval: float
    index: int = 5
    longest_edge: float = math.inf
    shortest: float = 0.0  # pieces shorter than this are left out


@dataclass(frozen=True, kw_only=True, eq=False)
class Compilation:
    """What a compilation deck says."""

    titles: tuple[str, ...]
    models: StereomodelSpecs
    stages: StageReadings  # as they were read
    raw: Block | None = None  # the stages as raw plates, each reading a point by its number; None: they are refined
    profiles: ProfileSpecs = field(default_factory=partial(empty, ProfileSpecs))
    grids: GridSpecs = field(default_factory=partial(empty, GridSpecs))
    datum: SoundingDatum | None = None  # None: no card
    contours: ContourSpec | None = None  # None: none are asked for
