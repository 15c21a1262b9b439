"""Attitudes of inertial units, and the misalignments of these: one of each camera.

With P the attitude as observed (`geometry.body`), B the misalignment and M the attitude of the photo, both in the
local vertical of the station where it stands, the residual is the rotation e from the observed to the adjusted
attitude of the body, about the axes of the body:

    P = exp([e]x) B M,   de = J(e) t,   J the inverse right Jacobian of rotations (`inverse_right_jacobian`)

where t is the rotation of the body by a step: B W d(omega, phi, kappa) of the photo, and V d(omega, phi, kappa) of
the misalignment, W and V being the axes of these angles along those of the photo and of the body. That the vertical
turns by 1.6e-7 rad for each metre of the station is in the residuals, and left out of the partials.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.kinds.parameter import ParameterUnknown
from musatpy.adjustment.kinds.photo_vectors import Deviations, PhotoVector
from musatpy.adjustment.network import NOTHING, MeasuredTies, Network, inverse_squares
from musatpy.adjustment.parameters import Effect, Parameters
from musatpy.arrays import BoolArray, FloatArray, IntArray
from musatpy.geometry.body import BodyAngles, body_matrix, inverse_right_jacobian, rotation_vector
from musatpy.geometry.collinearity import AngleForm, angle_rates, attitude_from_matrix, attitude_matrix
from musatpy.geometry.similarity import Similarity
from musatpy.model import MISALIGNMENT_ANGLES, Block, InertialConvention, ObservationKind, Program
from musatpy.model.tables import finite_rows
from musatpy.units import ARC_SECOND, DEGREE

_INERTIAL, _MISALIGNMENT = ObservationKind.INERTIAL_ATTITUDE, ObservationKind.MISALIGNMENT
_REST = 0.1 * ARC_SECOND


@dataclass(frozen=True, kw_only=True, eq=False)
class InertialTies(MeasuredTies):
    """Inertial attitudes that take part; misalignments in degrees, as on their cards."""

    form: BodyAngles
    body: FloatArray  # (d, 3, 3) P as observed
    given: FloatArray  # (d, 3) misalignment of the camera of each
    unknown: IntArray  # (d, 3) number of each of its angles among the unknown ones, -1: held

    def misalignment(self, state: State) -> FloatArray:
        """Return the misalignment (d, 3) rad of the camera of each photo."""
        out, unknown = self.given.copy(), self.unknown >= 0
        if unknown.any():
            out[unknown] = state.parameters[_MISALIGNMENT][self.unknown[unknown]]
        return out * DEGREE


class InertialAttitude(PhotoVector):
    """Small rotations about the axes of the body."""

    observed = _INERTIAL
    value = "angles"

    def with_starts(self, block: Block) -> Block:
        """Return the block, photos without an attitude starting from that of the inertial unit."""
        table, photos = block.inertial_attitudes, block.photos
        rows = np.flatnonzero(~finite_rows(photos.attitude[table.photo]))
        if block.inertial_convention is None or not len(rows):
            return block
        B = attitude_matrix(misalignments(block)[0] * DEGREE)[photos.camera[table.photo[rows]]]
        P = body_matrix(table.angles[rows], BodyAngles(block.inertial_convention.angles))
        attitude = np.array(photos.attitude)
        attitude[table.photo[rows]] = attitude_from_matrix(np.swapaxes(B, 1, 2) @ P)
        return replace(block, photos=replace(photos, attitude=attitude))

    def measured(self, block: Block, enters: BoolArray) -> MeasuredTies:
        """Return what takes part of the table of a block."""
        table, convention = block.inertial_attitudes, block.inertial_convention or InertialConvention()
        if not self.applies(block):
            return NOTHING
        given, number = misalignments(block)
        form, camera = BodyAngles(convention.angles), block.photos.camera[table.photo]
        return InertialTies(
            row=np.arange(table.count),
            photo=table.photo[:, None],
            point=np.zeros((table.count, 0), dtype=np.int64),
            value=table.angles,
            weight=inverse_squares(table.sigma),
            form=form,
            body=body_matrix(table.angles, form),
            given=given[camera],
            unknown=number[camera],
        )

    def values(self, block: Block, network: Network, state: State) -> FloatArray:
        """Return the residuals (rows, 3) rad, 0 in MUSAT-IIA."""
        return (
            self.residuals(network, block, state)
            if self.applies(block)
            else np.zeros((self._table(block).count, 3))
        )

    def deviations(self, network: Network, state: State) -> Deviations:
        """Return the small rotations from observed to adjusted attitudes, rad."""
        of = network.measured[_INERTIAL]
        assert isinstance(of, InertialTies)
        angles, form = of.misalignment(state), AngleForm.OMEGA_PHI_KAPPA
        photo, B = of.photo[:, 0], attitude_matrix(angles)
        residual = rotation_vector(of.body @ np.swapaxes(_bodies(of, network, state), 1, 2))
        J, attitude = inverse_right_jacobian(residual), state.attitude[photo]
        by_station = np.zeros((len(photo), 3, 6))
        by_station[..., 3:] = J @ B @ attitude_matrix(attitude) @ angle_rates(attitude, form)
        known = of.unknown >= 0
        by_misalignment = J @ B @ angle_rates(angles, form) * (DEGREE * known[:, None])
        used = slice(0, 3 if known.any() else 0)
        return Deviations(
            residual=residual,
            by_station=by_station,
            column=self.columns(network, _MISALIGNMENT, of.unknown)[:, used],
            by_parameters=by_misalignment[..., used],
        )

    def misfit(self, block: Block, network: Network, row: int, component: int, size: float) -> str:
        """Return in words that an attitude is off by `size` rad."""
        photo = block.photos.ids[block.inertial_attitudes.photo[row]]
        about = f"about the {self.observed.components[component]} of the body"
        return f"the inertial attitude of photo {photo} is {size / DEGREE:.3f} degrees off {about}"


class Misalignment(ParameterUnknown):
    """Omega, phi, kappa from camera to body, degrees, camera by camera."""

    observed = _MISALIGNMENT

    def parameters(self, block: Block) -> Parameters | None:
        """Return the unknown angles of cameras whose photos have inertial attitudes."""
        (given, number), ids = misalignments(block), block.cameras.ids
        if not (number >= 0).any():
            return None
        sigma = np.full(given.shape, np.nan)
        sigma[block.misalignments.camera] = block.misalignments.sigma / DEGREE
        units, of = ("deg",) * 3, {"effect_in": Effect.ANGLE, "rest": _REST}
        return Parameters.of_components(
            "misalignment", ids, MISALIGNMENT_ANGLES, units, number >= 0, given, sigma, DEGREE, **of
        )

    def transformed(self, network: Network, state: State, centre: FloatArray, move: Similarity) -> State:
        """Return the state with the misalignments that take up a rotation."""
        if not network.border.count(_MISALIGNMENT):
            return state
        changes = self._taken_up(network, state, centre) @ rotation_vector(move.rotation)
        after = state.parameters[_MISALIGNMENT] + changes
        return replace(state, parameters={**state.parameters, _MISALIGNMENT: after})

    def put_motions(self, network: Network, state: State, centre: FloatArray, motions: FloatArray) -> None:
        """Put what it takes up of the three rotations of a datum into `motions` (u, 7)."""
        if network.border.count(_MISALIGNMENT):
            self.part_of(network, motions)[:, 3:6] = self._taken_up(network, state, centre)

    def _taken_up(self, network: Network, state: State, centre: FloatArray) -> FloatArray:
        """Return (x, 3) the changes that hold bodies, on the average of a camera, where the block turns.

        Bodies turn by B M a with it: of vertical photos, all alike about the vertical alone.
        """
        of, out = network.measured[_INERTIAL], np.zeros((network.border.count(_MISALIGNMENT), 3))
        assert isinstance(of, InertialTies)
        angles = of.misalignment(state)
        B, V = attitude_matrix(angles), angle_rates(angles, AngleForm.OMEGA_PHI_KAPPA) * DEGREE
        turned = state.M[of.photo[:, 0]] @ network.frame.axes(centre).T
        for number in np.unique(of.unknown, axis=0):
            rows, free = np.flatnonzero((of.unknown == number).all(axis=1)), number >= 0
            out[number[free]] = -np.linalg.pinv((B @ V)[rows[0]][:, free]) @ (B @ turned)[rows].mean(axis=0)
        return out


def misalignments(block: Block) -> tuple[FloatArray, IntArray]:
    """Return misalignments (c, 3), degrees, of cameras, and the numbers (c, 3) of unknown angles, -1 of held ones.

    Those of cameras without inertial attitudes are held.
    """
    table, cameras = block.misalignments, block.cameras.count
    given, unknown = np.zeros((cameras, 3)), np.zeros((cameras, 3), dtype=bool)
    given[table.camera] = table.angles / DEGREE
    unknown[table.camera] = table.free[:, None] | np.isfinite(table.sigma)
    observed = np.isin(np.arange(cameras), block.photos.camera[block.inertial_attitudes.photo])
    unknown &= observed[:, None] & (block.options.program is Program.IIIA)
    return given, np.where(unknown, np.cumsum(unknown).reshape(unknown.shape) - 1, -1)


def _bodies(of: InertialTies, network: Network, state: State) -> FloatArray:
    """Return the adjusted attitudes (d, 3, 3) of the bodies."""
    photo = of.photo[:, 0]
    axes = network.frame.axes(state.position[photo])
    return attitude_matrix(of.misalignment(state)) @ state.M[photo] @ np.swapaxes(axes, 1, 2)


KINDS = (InertialAttitude(), Misalignment())
