"""Inertial attitudes beside an adjustment: conventions in which they would fit.

Where they do not fit as they are read, they are read otherwise, in one or two respects, and compared with attitudes
from images and control alone. What fits is said, and never applied.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.kinds.inertial import InertialTies
from musatpy.adjustment.network import Network
from musatpy.arrays import FloatArray
from musatpy.geometry.body import BodyAngles, body_matrix, rotation_vector
from musatpy.geometry.collinearity import attitude_from_matrix, attitude_matrix, orthogonal
from musatpy.model import Block, InertialAttitudes, Initial, Misalignments, ObservationKind
from musatpy.model.tables import empty
from musatpy.units import DEGREE, GON

_WELL = 10.0  # sigmas: most of what is read wrongly is farther off
_BETTER = 0.2  # of the misfit as they are read, that one of another convention has at most
_ALIKE = 3.0  # times the least misfit: readings that fit so are told together
_FINEST = 0.01 * DEGREE  # to which attitudes by images are worth comparing
_MOST, _TOLD = 100, 3  # records that are compared, and readings
_NAMES = {"OPK": ("omega", "phi", "kappa"), "POK": ("phi", "omega", "kappa"), "RPY": ("roll", "pitch", "heading")}
_I = np.eye(3)


def without_inertial(block: Block) -> Block:
    """Return the block without inertial attitudes; where these may have been starts, starts are computed."""
    options, nothing = replace(block.options, initial=Initial.COMPUTE), empty(InertialAttitudes)
    return replace(block, options=options, inertial_attitudes=nothing, misalignments=empty(Misalignments))


class _Deviation(NamedTuple):
    """How angles, or a misalignment, may be read otherwise; those of one `group` exclude each other."""

    words: str
    group: str
    angles: FloatArray = _I  # (3, 3) by which they are multiplied
    shift: float = 0.0  # degrees, of the last angle
    inverse: bool = False  # of the rotation
    form: BodyAngles | None = None
    misalignment: FloatArray = _I  # (3, 3) by which it is multiplied from the left
    from_body: bool = False  # the misalignment is that from body to camera


def _deviations(form: BodyAngles, free: bool) -> list[_Deviation]:
    """Return how angles of a form may be read otherwise, and misalignments unless they are free."""
    first, second, third = names = _NAMES[form]
    origin, turns = "clockwise from north" if third == "kappa" else "counterclockwise from east", (90, 180, -90)
    every = [
        *(
            _Deviation(f"as {one} ({', '.join(_NAMES[one])})", "form", form=one)
            for one in BodyAngles
            if one != form
        ),
        *(_Deviation(f"with {name} negative", name, _I - 2.0 * np.diag(_I[row])) for row, name in enumerate(names)),
        *(_Deviation(f"with {third} {turn} degrees more", third, shift=turn) for turn in turns),
        _Deviation(f"with {third} {origin}", third, np.diag([1.0, 1.0, -1.0]), 90.0),
        _Deviation(f"with {first} and {second} exchanged", "exchange", _I[[1, 0, 2]]),
        _Deviation("in gons", "unit", GON / DEGREE * _I),
        _Deviation("in radians", "unit", _I / DEGREE),
        _Deviation("from body to ground", "order", inverse=True),
        _Deviation("with the rotations in the opposite order", "order", -_I, inverse=True),
    ]
    of, kappa = "of the misalignment", [attitude_matrix([0.0, 0.0, turn * DEGREE]) for turn in turns]
    turned = [(f"with kappa {of} {turn} degrees more", R) for turn, R in zip(turns, kappa, strict=True)]
    turned += [(f"with y right and z down {of}", np.diag([1.0, -1.0, -1.0]))]
    mounted = [_Deviation(words, "MIS", misalignment=R) for words, R in turned]
    mounted += [_Deviation("with the misalignment from body to camera", "MIS", from_body=True)]
    return every if free else every + mounted


class _Records(NamedTuple):
    """d records, beside the attitudes of their photos by other means."""

    form: BodyAngles
    angles: FloatArray  # (d, 3) rad, as read
    M: FloatArray  # (d, 3, 3) east, north, up to photo
    B: FloatArray | None  # (d, 3, 3) misalignment as given; None: any that fits most

    def misfit(self, *deviations: _Deviation) -> tuple[float, FloatArray]:
        """Return the median angle (rad) by which the records do not fit where they are read so, and B."""
        angles, form, B = self.angles, self.form, self.B
        for one in deviations:
            angles, form = angles @ one.angles.T + one.shift * DEGREE * _I[2], one.form or form
            B = None if B is None else one.misalignment @ (np.swapaxes(B, 1, 2) if one.from_body else B)
        P, level = body_matrix(angles, form), body_matrix(np.zeros(3), form)
        if any(one.inverse for one in deviations):  # along the axes in which angles of zero turn nothing
            P = np.swapaxes(P @ level.T, 1, 2) @ level
        seen = P @ np.swapaxes(self.M, 1, 2)
        if B is None:  # the mean of the half nearest to that of all
            off = _apart(seen, orthogonal(seen.sum(axis=0)))
            B = orthogonal(seen[off <= np.median(off)].sum(axis=0))
        return float(np.median(_apart(seen, B))), B


def _apart(seen: FloatArray, B: FloatArray) -> FloatArray:
    """Return the angles (d,) rad between rotations (d, 3, 3) and others."""
    return np.linalg.norm(rotation_vector(seen @ np.swapaxes(B, -1, -2)), axis=-1)


def fitting_convention(block: Block, network: Network, alone: State) -> str:
    """Return in words how the inertial attitudes would fit a state that owes them nothing; empty if most do.

    Those of the first camera that has any are compared.
    """
    of, table = network.measured[ObservationKind.INERTIAL_ATTITUDE], block.misalignments
    assert isinstance(of, InertialTies)
    camera = block.photos.camera[of.photo[:, 0]]
    rows = np.flatnonzero(camera == camera[0])
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, _MOST).astype(int))]
    photo, free = of.photo[rows, 0], bool(table.free[table.camera == camera[0]].any())
    M = alone.M[photo] @ np.swapaxes(network.frame.axes(alone.position[photo]), 1, 2)
    given = None if free else attitude_matrix(of.given[rows] * DEGREE)
    records = _Records(of.form, of.value[rows], M, given)
    as_read, every = records.misfit()[0], _deviations(of.form, free)
    if as_read <= max(_WELL / np.sqrt(np.median(of.weight)), _FINEST):
        return ""
    off = f"the inertial attitudes read as {of.form} are {as_read / DEGREE:.2f} degrees off the images (median)"
    pairs = (pair for pair in itertools.combinations(every, 2) if pair[0].group != pair[1].group)
    readings: list[Sequence[_Deviation]] = [*((one,) for one in every), *pairs]
    fits, enough = np.array([records.misfit(*reading)[0] for reading in readings]), max(_BETTER * as_read, _FINEST)
    apart, B = records._replace(B=None).misfit()
    if fits.min() <= enough:
        good = np.flatnonzero(fits <= max(_ALIKE * fits.min(), _FINEST)).tolist()
        fewest = min(len(readings[row]) for row in good)
        names = [" and ".join(one.words for one in readings[row]) for row in good if len(readings[row]) == fewest]
        words, apart = f"read {', or '.join(names[:_TOLD])}", fits.min()
    elif apart <= enough:
        numbers = ", ".join(f"{angle / DEGREE:.3f}" for angle in attitude_from_matrix(B).tolist())
        words = f"with a misalignment of {numbers} degrees"
    else:
        return f"{off}, and no other convention that was tried fits them"
    return f"{off}: {words}, they would be {apart / DEGREE:.3f} degrees off; nothing was changed"
