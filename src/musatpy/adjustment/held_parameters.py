"""What errors would do that many observations have in common: of cameras, water, control and observed stations.

Such a parameter is no unknown, and nothing that is printed of single observations speaks of it. An error e of it
(given minus true) adds c e to the residuals. The adjustment, which does not know it, leaves r e of these, and moves
stations and points: external reliability (Baarda 1968). With the weights P and the residuals v of the solution

    r = c + A ds + B dX,   w = v'Pr / sqrt(r'Pr),   e = v'Pr / r'Pr,

w is normal where the parameter is right, and r'Pr = c'P Qvv P c. Movements and r come from the adjustment itself:
its right side with the parameter changed by a hundredth of its reference error, one solution by the factor of its
normals, and the points following. So they are those of every program, refraction and kernel.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from musatpy.adjustment.collinear import Simultaneous, eliminate
from musatpy.adjustment.datum import NOTHING_FREE, Freedom, moved_to
from musatpy.adjustment.ground import all_residuals, hold, prior_rows
from musatpy.adjustment.iteration import Linearisation, State, tide_groups
from musatpy.adjustment.kinds import direct_rows, state_after
from musatpy.adjustment.network import Network, Participation
from musatpy.adjustment.precision import Precision, left_out
from musatpy.arrays import BoolArray, FloatArray
from musatpy.geometry.geodesy import water_heights
from musatpy.model import Block, HeldParameters
from musatpy.model.tables import finite_rows

# Reference errors: a share, mm, 1, m, a share
FOCAL_LENGTH, PRINCIPAL_POINT, INDEX, HEIGHT, SCALE = 1e-3, 0.02, 0.005, 0.1, 1e-4
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
    """A parameter that is held: `altered` returns network and state with an error of a `size`."""

    name: str
    unit: str
    reference: float
    limit: float
    altered: Callable[..., Altered]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Begun:
    """A solution with an error of a parameter, not yet solved: its equations and residuals (o,)."""

    network: Network
    state: State
    line: Linearisation
    residual: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class _AtRest:
    """A solution at rest with the factor of its normal equations, of full weights."""

    block: Block
    network: Network
    state: State
    part: Participation
    known: Precision
    free: Freedom

    def observations(self, network: Network, state: State) -> tuple[FloatArray, FloatArray]:
        """Return residuals and weights (o,) of the images, of what is known of points, and of all others.

        Images that took no part have none of either.
        """
        used, parts = self.part.used[:, None], []
        images = np.where(used, all_residuals(network, state, self.part.used), 0.0)
        parts.append((images, network.weight * used))
        for group in (*network.control_groups, *network.kept_groups):
            rows = prior_rows(network, state, group.point, state.ground[group.point])
            parts.append((-rows.deviation, rows.weight))
        parts += [(rows.residual, rows.weight) for _, rows in direct_rows(network, state)]
        residual, weight = (np.concatenate([part.reshape(-1) for part in of]) for of in zip(*parts, strict=True))
        return residual, weight

    def begun(self, network: Network, state: State) -> _Begun:
        """Return the solution where its parameters are those of a network and state."""
        held = np.flatnonzero(network.priors.held.any(axis=1) & finite_rows(state.ground))
        if len(held):  # they are where the cards put them
            ground = state.ground.copy()
            ground[held] = hold(network, held, ground[held])
            state = replace(state, ground=ground)
        problem = Simultaneous(network=network, options=self.block.options, held=self.free.held)
        residual, _ = self.observations(network, state)
        return _Begun(network=network, state=state, line=problem.linearise(state), residual=residual)

    def after(self, begun: _Begun, step: FloatArray) -> State:
        """Return the state after a step (u,), which all points follow."""
        network, state, ground = begun.network, begun.state, begun.state.ground.copy()
        for follow in begun.line.context:
            follow.move(network, state, step, ground)
        for group in left_out(network, self.part):
            eliminate(network, state, group).follow(group).move(network, state, step, ground)
        return replace(state_after(network, state, step), ground=ground)

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

    def most_moved(
        self, before: Places, after: Places, size: float, reference: float
    ) -> list[tuple[int, float, float]]:
        """Return the station, the point, the depth that an error of `size` moves most in its own sigmas.

        With its movement (m, and sigmas) by an error of one unit; ordered as those of the `reference` error print.
        Sigmas of what is held are zero: it moves with its card.
        """
        found = []
        axes = (self.network.axes, self.network.frame.axes(before[1]), np.ones((1, 1, 1)))
        for old, new, along, sigma in zip(before, after, axes, self._sigmas, strict=True):
            move = (along @ ((new - old) / size)[..., None])[..., 0]
            relative = np.full(sigma.shape, np.nan)
            np.divide(np.abs(move), sigma, out=relative, where=sigma > 0.0)
            most = np.fmax.reduce(relative, axis=1)
            row = int(np.argmax(np.round(np.nan_to_num(most, nan=-np.inf) * reference, _DECIMALS)))
            known = np.isfinite(most[row])
            found.append((row, float(np.linalg.norm(move[row])), float(most[row])) if known else _NOTHING)
        return found

    def of_considered(self, altered: Callable[[Network, State], Altered], moved: State) -> FloatArray:
        """Return the right side (c,) of the considered parameters with what is left of an error."""
        wide = self.known.wide
        if wide is None:
            return np.zeros(0)
        network, _ = altered(wide.network, wide.state)
        state = replace(moved, waves=wide.state.waves)
        rhs = Simultaneous(network=network, options=self.block.options).linearise(state).rhs
        return rhs[network.pattern.order :][~wide.free] * wide.parameters.sigma


def held_parameters(
    block: Block,
    network: Network,
    state: State,
    part: Participation,
    known: Precision,
    free: Freedom | None,
) -> HeldParameters:
    """Return what errors of the parameters do that a solution at `state` holds.

    The residuals tested are those that a last step leaves: of WATPT, those of refracted rays.
    """
    rest = _AtRest(block=block, network=network, state=state, part=part, known=known, free=free or NOTHING_FREE)
    held = tuple(_parameters(block, network, part))
    errors = [partial(parameter.altered, size=_STEP * parameter.reference) for parameter in held]
    runs = [rest.begun(network, state), *(rest.begun(*altered(network, state)) for altered in errors)]
    scale = known.full.scale[:, None]
    steps = known.full.solve_scaled(np.stack([run.line.rhs for run in runs], axis=1) * scale) * scale
    base, *others = runs
    resting = rest.after(base, steps[:, 0])
    left, weight = rest.observations(network, resting)
    none = rest.of_considered(lambda *both: both, resting)
    sizes, numbers = np.array([_STEP * parameter.reference for parameter in held]), np.zeros((len(held), 4))
    before, worst = rest.places(resting), []
    for row, (run, altered) in enumerate(zip(others, errors, strict=True)):
        moved = rest.after(run, steps[:, 1 + row])
        c, r = run.residual - base.residual, rest.observations(run.network, moved)[0] - left
        Pr, of_considered = weight * r, rest.of_considered(altered, moved) - none
        numbers[row] = Pr @ left * sizes[row], Pr @ r, c @ (weight * c), of_considered @ of_considered
        if len(rest.free.held):
            moved, _ = moved_to(network, moved, rest.free, resting.ground)
        worst.append(rest.most_moved(before, rest.places(moved), sizes[row], held[row].reference))
    moves = np.array(worst).reshape(-1, 3, 3)
    pull, redundant, whole, considered = (numbers / np.square(sizes)[:, None]).T
    return HeldParameters(
        names=np.array([parameter.name for parameter in held], dtype=np.str_),
        units=np.array([parameter.unit for parameter in held], dtype=np.str_),
        reference=np.array([parameter.reference for parameter in held]),
        limit=np.array([parameter.limit for parameter in held]),
        pull=pull,
        redundant=redundant,
        whole=whole,
        considered=considered,
        moved=moves[..., 0].astype(int),
        shift=moves[..., 1],
        sigmas=moves[..., 2],
        adjusted=int(network.water.index_unknown) + int((network.water.group >= 0).any()),
        known_with_sigma=int(_index_considered(block, network)) + int(_tides_considered(block, network).any()),
    )


def _parameters(block: Block, network: Network, part: Participation) -> Iterator[Parameter]:
    """Yield the parameters that are held, neither adjusted nor considered."""
    for camera in np.unique(block.photos.camera[network.photo[part.used]]).tolist():
        yield from _of_camera(block, camera)
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

    for what, reference, altered in (
        (f"focal length of {name}", FOCAL_LENGTH * focal, focal_length),
        (f"principal point x, {name}", PRINCIPAL_POINT, partial(principal_point, 0)),
        (f"principal point y, {name}", PRINCIPAL_POINT, partial(principal_point, 1)),
    ):
        yield Parameter(name=what, unit="mm", reference=reference, limit=MOST_CAMERA * focal, altered=altered)


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
