"""Stages that are read raw: every plate lies on its carrier in its own way, and its marks are measured there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from musatpy import model
from musatpy.arrays import FloatArray, IntArray
from musatpy.draws import Draws
from musatpy.model.compilation import Compilation
from musatpy.model.tables import empty
from musatpy.simulation.simulation_spec import SimulationSpec
from musatpy.units import MICROMETRE

_MARKS = 0.46  # of the format, from the middle: where the marks are
_AXES = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1], [1, 0], [0, 1], [-1, 0], [0, -1]], dtype=float)
_SHRINK = 5e-4  # of the film, along either axis
_TURN = 0.02  # rad, of a plate on its carrier, but for quarters of a turn
_SHIFT = (90.0, 160.0)  # mm, of its middle from the origin of the carrier
_STREAM = "compilation interior "


@dataclass(frozen=True, kw_only=True)
class _Carrier:
    """Readings A xy + t of plate coordinates xy: A (p, 2, 2) and t (p, 2) of the plates."""

    A: FloatArray
    t: FloatArray

    def readings(self, plate: IntArray, xy: FloatArray) -> FloatArray:
        """Return the readings (k, 2) of plate coordinates (k, 2) on plates (k,)."""
        return np.einsum("kij,kj->ki", self.A[plate], xy) + self.t[plate]


def read_raw(
    deck: Compilation, spec: SimulationSpec, ids: Sequence[str], pointing: float, draws: Draws
) -> Compilation:
    """Return a deck of refined stages as they are read raw, with an interior orientation of every photo in it.

    ids (n,) are all photos; marks have errors of `pointing` (um).
    """
    sides = (deck.models.left, deck.models.right)
    used = [name for name in ids if any(name in side for side in sides)]
    row = {name: number for number, name in enumerate(used)}
    carrier, stages = _carrier(len(used), draws), deck.stages
    both = [np.array([row[name] for name in side[stages.model].tolist()]) for side in sides]
    xy = np.stack([carrier.readings(plate, stages.xy[:, side]) for side, plate in enumerate(both)], axis=1)
    stages = replace(stages, xy=np.round(xy, 6))
    return replace(deck, stages=stages, raw=_plates(spec, used, both, stages, carrier, pointing, draws))


def _carrier(count: int, draws: Draws) -> _Carrier:
    turn = 0.5 * np.pi * np.floor(4.0 * draws.uniform(f"{_STREAM}quarter", count))
    turn = turn + _TURN * (2.0 * draws.uniform(f"{_STREAM}turn", count) - 1.0)
    c, s = np.cos(turn), np.sin(turn)
    film = 1.0 + _SHRINK * (2.0 * draws.uniform(f"{_STREAM}film", count, 2) - 1.0)
    A = np.stack([np.stack([c, -s], axis=1), np.stack([s, c], axis=1)], axis=1) * film[:, None]
    low, high = _SHIFT
    return _Carrier(A=A, t=low + (high - low) * draws.uniform(f"{_STREAM}shift", count, 2))


def _plates(
    spec: SimulationSpec,
    photos: list[str],
    both: list[IntArray],
    stages: model.compilation.StageReadings,
    carrier: _Carrier,
    pointing: float,
    draws: Draws,
) -> model.Block:
    """Return the readings as raw plates of a block, each a point by its number, with the marks of all photos."""
    camera, count, marks = spec.camera, len(stages.ids), len(_AXES)
    places = np.round(_MARKS * np.array(camera.format) * _AXES + camera.principal_point, 3)
    plate: IntArray = np.repeat(np.arange(len(photos)), marks)
    error = pointing * MICROMETRE * draws.normal(f"{_STREAM}marks", len(plate), 2)
    names, nothing = np.array([f"{number}" for number in range(1, marks + 1)]), np.full((len(photos), 3), np.nan)
    return model.Block(
        titles=(),
        options=model.Options(),
        cameras=model.Cameras(
            ids=np.array([camera.id]),
            focal_length=np.array([camera.focal_length]),
            principal_point=np.array([camera.principal_point]),
            format_size=np.array([camera.format]),
        ),
        fiducials=model.Fiducials(
            camera=np.zeros(marks, dtype=np.int64), ids=names, xy=places, sigma=np.full((marks, 2), np.nan)
        ),
        photos=model.Photos(
            ids=np.array(photos),
            camera=np.zeros(len(photos), dtype=np.int64),
            position=nothing,
            position_sigma=nothing,
            attitude=nothing,
            attitude_sigma=nothing,
            tide=np.full(len(photos), np.nan),
        ),
        fiducial_measurements=model.FiducialMeasurements(
            photo=plate,
            ids=np.tile(names, len(photos)),
            xy=np.round(carrier.readings(plate, np.tile(places, (len(photos), 1))) + error, 7),
            sigma=np.full((len(plate), 2), np.nan),
        ),
        points=model.Points(ids=np.arange(count).astype(np.str_), bathymetric=stages.submerged),
        plates=model.PlateMeasurements(
            photo=np.concatenate(both),
            point=np.tile(np.arange(count), 2),
            xy=np.concatenate([stages.xy[:, 0], stages.xy[:, 1]]),
            sigma=np.full((2 * count, 2), np.nan),
            triangulated=np.ones(2 * count, dtype=bool),
        ),
        control=empty(model.Control),
        reduction=model.ReductionOptions(plates=model.Plates.RAW),
    )
