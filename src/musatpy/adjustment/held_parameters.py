"""What errors would do that many observations have in common: of cameras, water, control and observed stations.

Such a parameter is no unknown, and nothing that is printed of single observations speaks of it. An error e of it
(given minus true) adds c e to the residuals. The adjustment, which does not know it, leaves r e of these, and moves
stations and points: external reliability (Baarda 1968). With the weights P and the residuals v of the solution

    r = c + A ds + B dX,   w = v'Pr / sqrt(r'Pr),   e = v'Pr / r'Pr,

w is normal where the parameter is right, and r'Pr = c'P Qvv P c. The columns c are the differences of the residuals
by a hundredth of the reference error, of what it changes alone; all are solved for at once, by the factor of the
normals of the adjustment, and the points follow. The residuals themselves are one column more, the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from musatpy.adjustment.collinear import Simultaneous
from musatpy.adjustment.datum import NOTHING_FREE, Freedom, moved_to
from musatpy.adjustment.ground import hold, prior_rows
from musatpy.adjustment.iteration import State, tide_groups
from musatpy.adjustment.kinds import direct_rows, state_after
from musatpy.adjustment.kinds.kind import Rows
from musatpy.adjustment.network import RAYS, Network, Participation, kept_axes, parts_of, together
from musatpy.adjustment.precision import Covariances
from musatpy.adjustment.propagation import PointRows, point_rows
from musatpy.adjustment.sightings import residuals
from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.geodesy import water_heights
from musatpy.model import PORT_PARAMETERS, Block, HeldParameters, ObservationKind, Program
from musatpy.model.tables import finite_rows

# Reference errors: a share, mm, 1, m, a share
FOCAL_LENGTH, PRINCIPAL_POINT, INDEX, HEIGHT, SCALE = 1e-3, 0.02, 0.005, 0.1, 1e-4
PORT_DISTANCE, MOST_PORT_DISTANCE = 1.0, 50.0  # mm
MOST_CAMERA, MOST_INDEX, MOST_HEIGHT, MOST_SCALE = 0.02, 0.02, 5.0, 0.01  # of focal lengths, 1, m, 1
TIDES, CONTROL_HEIGHTS = "tides", "heights of control"
_STEP = 0.01  # of the reference error: rounding leaves six digits of the differences, curvature four
_DECIMALS = 1  # of sigmas, as they are printed
_NOTHING = (-1, np.nan, np.nan)  # has a sigma

Altered = tuple[Network, State]
Places = tuple[FloatArray, FloatArray, FloatArray]  # of stations, points and depths
Changed = Callable[[Network, FloatArray, float], FloatArray]  # level coordinates (k, 3), with an error of a size


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameter:
    """A parameter that is held: `altered` returns network and state with an error of a size."""

    name: str
    unit: str
    reference: float
    limit: float
    altered: Callable[..., Altered]

    @property
    def size(self) -> float:
        """The error that the differences are taken with."""
        return _STEP * self.reference


@dataclass(frozen=True, kw_only=True, eq=False)
class _AtRest:
    """A solution at rest with the factor of its normal equations, of full weights."""

    block: Block
    network: Network
    state: State
    part: Participation
    known: Covariances
    free: Freedom

    @cached_property
    def rows(self) -> list[PointRows]:
        """The observations of the points that took part."""
        left, rows = self.known.loops.observations(self.state)
        parts = parts_of(together(left), RAYS)
        return [*rows, *(point_rows(self.network, self.state, part) for part in parts)]

    def errors(self, held: Sequence[Parameter], cards: Sequence[Altered]) -> list[FloatArray]:
        """Return residuals, and by parameters what an error of one unit adds to them, as 1 + P columns.

        `cards` are network and state with an error of each. Of images and of what is known of points
        (m + 2p, 2, 1 + P), as `PointRows` counts these, then of each kind of all other observations.
        """
        every_ray = np.ones(len(self.network.photo), dtype=bool)
        none = np.zeros((len(every_ray) + 2 * self.network.points, 2))
        base = _residuals(self.network, self.state, every_ray, none)
        columns = [base]
        for parameter, (network, state) in zip(held, cards, strict=True):
            altered = _residuals(network, state, self._touched(network, state), base[0])
            columns.append([(after - before) / parameter.size for before, after in zip(base, altered, strict=True)])
        return [np.stack(of, axis=-1) for of in zip(*columns, strict=True)]

    def altered(self, parameter: Parameter) -> Altered:
        """Return network and state with an error of a parameter: held points are where the cards put them."""
        network, state = parameter.altered(self.network, self.state, parameter.size)
        held = np.flatnonzero(network.priors.held.any(axis=1) & finite_rows(state.ground))
        ground = state.ground.copy()
        ground[held] = hold(network, held, ground[held])
        return network, replace(state, ground=ground)

    def _touched(self, network: Network, state: State) -> BoolArray:
        """Return which images (m,) are others in an altered network and state."""
        old, before = self.network, self.state
        camera = np.column_stack([network.focal_length, network.principal_point])
        photo = (camera != np.column_stack([old.focal_length, old.principal_point])).any(axis=1)
        if network.ports is not None and old.ports is not None:
            photo |= (network.ports.held != old.ports.held).any(axis=1)[network.ports.camera]
        wet, point = (state.tide != before.tide) | (state.index != before.index), state.ground != before.ground
        return photo[old.photo] | (old.refracted & wet[old.photo]) | point.any(axis=1)[old.point]

    def solved(self, weighted: Sequence[FloatArray], direct: Sequence[tuple[Rows, FloatArray]]) -> FloatArray:
        """Return the steps (u, P) of stations and globals by errors, those of the lines of `rows` weighted."""
        network, scale = self.network, self.known.full.scale[:, None]
        rhs = np.zeros((len(scale), weighted[0].shape[2]))
        for rows, errors in zip(self.rows, weighted, strict=True):
            rows.add_rhs(network, rows.left(errors)[0], rhs)
        for others, errors in direct:
            partials = others.partials * others.weight[:, None]
            np.add.at(rhs, others.index, -partials[:, :, None] * errors[:, None])
        rhs[self.free.held] = 0.0
        return self.known.full.solve_scaled(rhs * scale) * scale

    def of_considered(self, moved: State, parameter: Parameter | None = None) -> FloatArray:
        """Return the right side (c,) of the considered parameters with what is left of an error, if any."""
        wide = self.known.wide
        if wide is None:
            return np.zeros(0)
        network, state = wide.network, replace(moved, waves=wide.state.waves, parameters=wide.state.parameters)
        if parameter is not None:
            network, _ = parameter.altered(network, state, parameter.size)
        rhs = Simultaneous(network=network, options=self.block.options).linearise(state).rhs
        return rhs[network.pattern.order :][~wide.free] * wide.parameters.sigma

    def places(self, state: State) -> Places:
        """Return stations (n, 3), points (p, 3), and depths (p, 1) m below the mean water at their photos."""
        network, wet = self.network, self.block.points.bathymetric & finite_rows(self.state.ground)
        rays = np.flatnonzero(wet[network.point])
        point, tide = network.point[rays], state.tide[network.photo[rays]]
        water = water_heights(network.slope(state.tilt), tide, state.ground[point])
        sums, count = np.bincount(point, water, len(wet)), np.bincount(point, minlength=len(wet))
        depth = np.full((len(wet), 1), np.nan)
        depth[wet, 0] = sums[wet] / count[wet] - network.frame.height(state.ground[wet])
        return state.position, state.ground, depth

    @cached_property
    def _sigmas(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The sigmas of stations (n, 3) and points (p, 3) along east, north, up, and of depths (p, 1)."""
        stations = np.einsum("nii->ni", self.known.unknowns.of_single_photos())[:, :3]
        variances = (stations, np.einsum("kii->ki", self.known.points), self.known.depths[:, None])
        first, second, third = (np.sqrt(np.maximum(variance, 0.0)) for variance in variances)
        return first, second, third

    @cached_property
    def _axes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The axes of these: (n, 3, 3), (p, 3, 3), (1, 1, 1)."""
        frame = self.network.frame  # photos may be adjusted along their axes in another order
        return frame.axes(self.network.position), frame.axes(self.state.ground), np.ones((1, 1, 1))

    def most_moved(self, before: Places, after: Sequence[Places], held: Sequence[Parameter]) -> FloatArray:
        """Return (P, 3, 3): the station, the point, the depth that an error of each moves most in its own sigmas.

        With its movement (m, and sigmas) by an error of one unit; ordered as those of the reference error print.
        Sigmas of what is held are zero: it moves with its card.
        """
        reference, size = (np.array([getattr(of, name) for of in held]) for name in ("reference", "size"))
        found = []
        if not held:  # where all of the camera is unknown, and there is no water
            return np.zeros((0, 3, 3))
        for old, new, along, sigma in zip(before, zip(*after, strict=True), self._axes, self._sigmas, strict=True):
            move = along @ ((np.stack(new, axis=-1) - old[..., None]) / size)
            relative = np.full(move.shape, np.nan)
            np.divide(np.abs(move), sigma[..., None], out=relative, where=sigma[..., None] > 0.0)
            most = np.fmax.reduce(relative, axis=1)
            row = np.argmax(np.round(np.nan_to_num(most, nan=-np.inf) * reference, _DECIMALS), axis=0)
            parameter = np.arange(len(held))
            shift, sigmas = np.linalg.norm(move[row, :, parameter], axis=1), most[row, parameter]
            found.append(np.where(np.isfinite(sigmas)[:, None], np.column_stack([row, shift, sigmas]), _NOTHING))
        return np.stack(found, axis=1)


def _residuals(network: Network, state: State, images: BoolArray, lines: FloatArray) -> list[FloatArray]:
    """Return residuals as `_AtRest.errors` has them, those of images that are not chosen (m,) out of `lines`."""
    lines, rays = lines.copy(), np.flatnonzero(images & finite_rows(state.ground)[network.point])
    lines[rays] = residuals(network, state, rays)
    known = lines[len(network.photo) :].reshape(network.points, 4)
    for group in together((*network.control_groups, *network.kept_groups)):
        known[group.point] = -prior_rows(network, state, group.point, state.ground[group.point]).deviation
    return [lines, *(rows.residual for _, rows in direct_rows(network, state))]


def held_parameters(
    block: Block,
    network: Network,
    state: State,
    part: Participation,
    known: Covariances,
    free: Freedom | None,
) -> HeldParameters:
    """Return what errors of the parameters do that a solution at `state` holds.

    The residuals tested are those that a last step leaves: of WATPT, those of refracted rays.
    """
    rest = _AtRest(block=block, network=network, state=state, part=part, known=known, free=free or NOTHING_FREE)
    held = tuple(_parameters(block, network, part))
    cards = [rest.altered(parameter) for parameter in held]
    lines, *of_direct = rest.errors(held, cards)
    direct = list(zip((rows for _, rows in direct_rows(network, state)), of_direct, strict=True))
    weighted = [rows.weighted(lines) for rows in rest.rows]
    step, split = rest.solved(weighted, direct), network.pattern.order
    whole, left = np.zeros((2, lines.shape[2], lines.shape[2]))
    moves = np.zeros((*state.ground.shape, lines.shape[2]))
    for rows, errors in zip(rest.rows, weighted, strict=True):
        remaining, of_points = rows.left(errors + rows.by_unknowns(network, step))
        moves[rows.point] = np.swapaxes(rows.axes, 1, 2) @ of_points
        whole, left = whole + _squares(errors), left + _squares(remaining)
    for others, errors in direct:
        root, change = np.sqrt(others.weight)[:, None], np.einsum("rx,rxp->rp", others.partials, step[others.index])
        whole, left = whole + _squares(root * errors), left + _squares(root * (errors + change))
    kept = network.border.kept
    axes = np.swapaxes(kept_axes(network, state.ground[kept]), 1, 2)
    moves[kept] = axes @ step[split + network.border.kept_columns(kept)]
    for group in network.left_out:
        rows = point_rows(network, state, group)
        _, of_points = rows.left(rows.weighted(lines) + rows.by_unknowns(network, step))
        moves[rows.point] = np.swapaxes(rows.axes, 1, 2) @ of_points
    none, after, considered = rest.of_considered(state), [], []
    for row, (parameter, (_, moved)) in enumerate(zip(held, cards, strict=True), start=1):
        ground = moved.ground + parameter.size * moves[..., row]
        moved = replace(state_after(network, moved, parameter.size * step[:, row]), ground=ground)
        considered.append((rest.of_considered(moved, parameter) - none) / parameter.size)
        if len(rest.free.held):
            moved, _ = moved_to(network, moved, rest.free, state.ground)
        after.append(rest.places(moved))
    most = rest.most_moved(rest.places(state), after, held)
    return HeldParameters(
        names=np.array([parameter.name for parameter in held], dtype=np.str_),
        units=np.array([parameter.unit for parameter in held], dtype=np.str_),
        reference=np.array([parameter.reference for parameter in held]),
        limit=np.array([parameter.limit for parameter in held]),
        pull=left[0, 1:],
        redundant=np.diagonal(left)[1:],
        whole=np.diagonal(whole)[1:],
        considered=np.array([of @ of for of in considered]),
        moved=most[..., 0].astype(int),
        shift=most[..., 1],
        sigmas=most[..., 2],
        adjusted=int(network.water.index_unknown) + int((network.water.group >= 0).any()),
        known_with_sigma=int(_index_considered(block, network)) + int(_tides_considered(block, network).any()),
    )


def _squares(errors: FloatArray) -> FloatArray:
    """Return the sums (P, P) of products of errors (..., P)."""
    columns = errors.reshape(-1, errors.shape[-1])
    return columns.T @ columns


def _parameters(block: Block, network: Network, part: Participation) -> Iterator[Parameter]:
    """Yield the parameters that are held, neither adjusted nor considered."""
    for camera in np.unique(block.photos.camera[network.photo[part.used]]).tolist():
        yield from _of_camera(block, camera)
        yield from _of_port(block, network, camera)
    priors, stations = network.priors, network.position_weight > 0.0
    bound = np.zeros(network.points, dtype=bool)
    for group in (*network.control_groups, *network.kept_groups):
        bound[group.point] = True
    control = priors.known & bound[:, None]
    tides: tuple[Parameter, ...] = ()
    if bool((network.refracted & part.used).any()):
        if not network.water.index_unknown and not _index_considered(block, network):
            yield Parameter(name="refractive index", unit="", reference=INDEX, limit=MOST_INDEX, altered=_index)
        tides = tuple(_tides(block, network, part))
    # where nothing else holds the heights of a block, that of all of it is nobody's error: water and control differ
    together = bool(tides) and control[:, 2].any() and not stations[:, 2].any()
    together = together and tides[0].name == TIDES and not _tides_unknown(block, network).any()
    if together:
        tides = (replace(tides[0], name=f"{TIDES} less {CONTROL_HEIGHTS}"), *tides[1:])
    yield from tides
    if control[:, 2].any() and not together:
        yield _height(CONTROL_HEIGHTS, partial(_control, control[:, 2], _raised))
    if np.count_nonzero(control[:, 0]) > 1:
        yield _scale("scale of control", partial(_control, control[:, 0], _enlarged))
    if stations[:, 2].any():
        yield _height("heights of stations", partial(_stations, stations[:, 2], _raised))
    if np.count_nonzero(stations[:, 0]) > 1:
        yield _scale("scale of stations", partial(_stations, stations[:, 0], _enlarged))


def _height(name: str, altered: Callable[..., Altered]) -> Parameter:
    return Parameter(name=name, unit="m", reference=HEIGHT, limit=MOST_HEIGHT, altered=altered)


def _scale(name: str, altered: Callable[..., Altered]) -> Parameter:
    return Parameter(name=name, unit="", reference=SCALE, limit=MOST_SCALE, altered=altered)


def _of_camera(block: Block, camera: int) -> Iterator[Parameter]:
    """Yield focal length and principal point of a camera."""
    focal, name = float(block.cameras.focal_length[camera]), block.cameras.ids[camera]
    on = block.photos.camera == camera

    def focal_length(network: Network, state: State, size: float) -> Altered:
        return replace(network, focal_length=network.focal_length + size * on), state

    def principal_point(axis: int, network: Network, state: State, size: float) -> Altered:
        xy = network.principal_point + size * on[:, None] * np.eye(2)[axis]
        return replace(network, principal_point=xy), state

    table, adjusted = block.lens_unknowns, block.options.program is Program.IIIA
    known = table.parameter[(table.camera == camera) & (adjusted | np.isfinite(table.sigma))]
    for parameter, what, reference, altered in (
        ("F", f"focal length of {name}", FOCAL_LENGTH * focal, focal_length),
        ("XP", f"principal point x, {name}", PRINCIPAL_POINT, partial(principal_point, 0)),
        ("YP", f"principal point y, {name}", PRINCIPAL_POINT, partial(principal_point, 1)),
    ):
        if parameter in known:
            continue
        yield Parameter(name=what, unit="mm", reference=reference, limit=MOST_CAMERA * focal, altered=altered)


def _of_port(block: Block, network: Network, camera: int) -> Iterator[Parameter]:
    """Yield the distance of the port of a camera under water, and the index of this; with air outside, nothing."""
    ports, name = network.ports, block.cameras.ids[camera]
    if ports is None or ports.held[camera, PORT_PARAMETERS.index("PW")] == 1.0:
        return
    for column, what, unit, reference, limit in (
        (PORT_PARAMETERS.index("PD"), f"distance of port, {name}", "mm", PORT_DISTANCE, MOST_PORT_DISTANCE),
        (PORT_PARAMETERS.index("PW"), f"water at port, {name}", "", INDEX, MOST_INDEX),
    ):
        if not ports.unknown[camera, column]:
            altered = partial(_port, camera, column)
            yield Parameter(name=what, unit=unit, reference=reference, limit=limit, altered=altered)


def _port(camera: int, column: int, network: Network, state: State, size: float) -> Altered:
    ports = network.ports
    assert ports is not None, "some camera has a port"
    held = ports.held.copy()
    held[camera, column] += size
    return network.with_parameters({ObservationKind.PORT: replace(ports, held=held)}), state


def _index_considered(block: Block, network: Network) -> bool:
    return block.water is not None and bool(block.water.sigma) and not network.water.index_unknown


def _tides_considered(block: Block, network: Network) -> BoolArray:
    return (network.water.group < 0) & (block.photos.tide_sigma > 0.0)


def _tides_unknown(block: Block, network: Network) -> BoolArray:
    """Return which tides (n,) are adjusted or considered."""
    return (network.water.group >= 0) | _tides_considered(block, network)


def _index(network: Network, state: State, size: float) -> Altered:
    water = replace(network.water, index=network.water.index + size)
    return replace(network, water=water), replace(state, index=state.index + size)


def _tides(block: Block, network: Network, part: Participation) -> Iterator[Parameter]:
    """Yield the tides of all photos of refracted images, of groups, and of days: as far as they are held."""
    seen = np.zeros(network.photos, dtype=bool)
    seen[network.photo[network.refracted & part.used]] = True
    known = seen & ~_tides_unknown(block, network)
    groups = tuple(tide_groups(block, known)) or ((("", np.flatnonzero(known)),) if known.any() else ())
    for name, photos in groups:
        on = np.isin(np.arange(network.photos), photos)
        yield _height(f"{TIDES} of {name}" if name else TIDES, partial(_tide, on))


def _tide(on: BoolArray, network: Network, state: State, size: float) -> Altered:
    water = replace(network.water, tide=network.water.tide + size * on)
    return replace(network, water=water), replace(state, tide=state.tide + size * on)


def _control(chosen: BoolArray, changed: Changed, network: Network, state: State, size: float) -> Altered:
    given = network.priors.given.copy()
    given[chosen] = changed(network, given[chosen], size)
    return replace(network, priors=replace(network.priors, given=given)), state


def _stations(chosen: BoolArray, changed: Changed, network: Network, state: State, size: float) -> Altered:
    position = network.position.copy()
    level = changed(network, network.frame.level(position[chosen]), size)
    position[chosen] = network.frame.from_level(level)
    return replace(network, position=position), state


def _raised(network: Network, level: FloatArray, size: float) -> FloatArray:
    """Return level coordinates (k, 3) higher by `size` m."""
    return level + size * np.array([0.0, 0.0, 1.0])


def _enlarged(network: Network, level: FloatArray, size: float) -> FloatArray:
    """Return level coordinates (k, 3) with their plan larger by a share `size`, about its middle.

    Heights may be NaN: of control that has none.
    """
    plan = level[:, :2]
    return np.column_stack([plan + size * (plan - plan.mean(axis=0)), level[:, 2]])
