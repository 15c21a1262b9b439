"""What every orientation of a scene has: photos, points and the water, in the system of the job or of a model."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix
from musatpy.model import Block, Grade
from musatpy.model.findings import GRADES, Concern, Reason, Verdict
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.orienting.scene import Scene


@dataclass(frozen=True, kw_only=True, eq=False)
class Placement(ABC):
    """Photos and points of a scene as oriented. Arrays have m photos and p points; sigmas are scaled by sigma0."""

    scene: Scene

    @property
    @abstractmethod
    def at(self) -> Orientation:
        """The photos over the water, in the axes of the scene."""

    @property
    @abstractmethod
    def inside(self) -> FloatArray:
        """(p, 3) the points in these axes, NaN for those without a place."""

    @property
    @abstractmethod
    def depth(self) -> FloatArray:
        """(p,) m, of the points below the water; negative above it."""

    @property
    @abstractmethod
    def outliers(self) -> BoolArray:
        """(p,) points that are left out, as they do not fit."""

    @property
    @abstractmethod
    def rays(self) -> IntArray:
        """(p,) images that took part."""

    @property
    @abstractmethod
    def sigma0(self) -> float:
        """Standard deviation of unit weight, NaN without redundancy."""

    @property
    @abstractmethod
    def summary(self) -> str:
        """The plane of water in a few words."""

    @abstractmethod
    def reasons(self) -> list[Reason]:
        """Return what speaks against the answer, besides points on the wrong side of the water."""

    @property
    def block(self) -> Block:
        """The block, its plates refined."""
        return self.scene.block

    @property
    def photos(self) -> TextArray:
        """(m,)."""
        return self.scene.sights.photos

    @cached_property
    def position(self) -> FloatArray:
        """(m, 3) in the system of the job, or of the model."""
        return self.scene.axes.system(self.at.station)

    @cached_property
    def attitude(self) -> FloatArray:
        """(m, 3) rad, in the local vertical of the station, or the axes of the model."""
        turn = self.scene.axes.local_turn(self.at.station)
        return attitude_from_matrix(attitude_matrix(self.at.attitude) @ np.swapaxes(turn, -1, -2))

    @cached_property
    def point_position(self) -> FloatArray:
        """(p, 3) in the system of the job, or of the model, NaN where there is none."""
        inside = self.inside
        place = np.full(inside.shape, np.nan)
        known = np.isfinite(inside).all(axis=1)
        place[known] = self.scene.axes.system(inside[known])
        return place

    @property
    def control(self) -> TextArray:
        """(p,) the components that are known: XYZ, XY, XZ, ..., or nothing."""
        known = np.isfinite(self.scene.sights.control)
        texts = np.char.add(np.where(known[:, 0], "X", ""), np.where(known[:, 1], "Y", ""))
        return np.char.add(texts, np.where(known[:, 2], "Z", ""))

    @cached_property
    def contradictions(self) -> tuple[str, ...]:
        """Points on the other side of the water than their flag says."""
        ids, wet = self.scene.sights.points, self.scene.sights.wet
        above, below = wet & (self.depth < 0.0), ~wet & (self.depth > 0.0)
        parts = (
            (above, "flagged submerged, and stand above the water"),
            (below, "not flagged submerged, and stand under it"),
        )
        return tuple(f"points {', '.join(ids[rows].tolist())} are {what}" for rows, what in parts if rows.any())

    @cached_property
    def verdict(self) -> Verdict:
        """What the answer is worth."""
        reasons = [*self.reasons(), *(doubt(Concern.STATION, text) for text in self.contradictions)]
        return Verdict(reasons=tuple(sorted(reasons, key=lambda reason: -GRADES.index(reason.grade))))


def doubt(concern: Concern, text: str) -> Reason:
    """Return a reason for doubt."""
    return Reason(grade=Grade.DOUBTFUL, concern=concern, text=text, section="")


def misfit(sigma0: float, what: str = "images") -> Reason:
    """Return the reason to reject an answer whose images, or `what` there is, do not fit."""
    text = f"sigma0 {sigma0:.3g}: the {what} do not fit, by the test of 99.9 %"
    return Reason(grade=Grade.REJECTED, concern=Concern.SIGMA0, text=text, section="")


def left_out(ids: TextArray, outliers: BoolArray) -> list[Reason]:
    """Return the doubt of points that do not fit."""
    text = f"left out, as they do not fit: {', '.join(ids[outliers].tolist())}"
    return [doubt(Concern.OBSERVATION, text)] if outliers.any() else []
