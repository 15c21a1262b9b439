"""Further parameters as unknowns, of cameras and lines: what is known of them beforehand, and what came out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from musatpy.adjustment.network import inverse_squares
from musatpy.arrays import BoolArray, FloatArray, IntArray, TextArray
from musatpy.model import TIES, AdjustedParameters, Block

if TYPE_CHECKING:
    from musatpy.adjustment.iteration import State
    from musatpy.adjustment.network import Network
    from musatpy.adjustment.normals import Cofactors
    from musatpy.adjustment.precision import Covariances

_REST = 1e-5  # mm of an image in the corner of the plate; behind a port, of a point at its range
_DECIMALS = 6  # of correlations, beyond which rounding errors order them

_MOVED = 1e-6  # of the largest change of an unknown by a free motion
_MOST = 50.0  # sigmas of an image, by which the sigma of what is determined turns rays at most
_INFORMATIVE = 0.1  # rad, by which the sigma of a prior that says something turns rays at most: 0.1 of the height


class Effect(Enum):
    """In what the effect of a parameter is stated."""

    IMAGE = "mm in an image"
    ANGLE = "rad"
    PLACE = "m at a station"


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameters:
    """What is known beforehand of the x unknown parameters of one kind, in the order of their columns.

    The iteration ends when none of their changes has more `effect` than `rest`.
    """

    noun: str  # of what they are: `camera`
    owner: tuple[str, ...]  # (x,) ids
    parameter: tuple[str, ...]  # (x,)
    unit: tuple[str, ...]  # (x,)
    given: FloatArray  # (x,)
    weight: FloatArray  # (x,) of what is given, 0 of what is free
    effect: FloatArray  # (x,) of one unit
    effect_in: Effect
    rest: float

    @classmethod
    def of_components(
        cls, noun: str, owners: TextArray, names: Sequence[str], units: Sequence[str], which: BoolArray,
        given: FloatArray, sigma: FloatArray, effect: FloatArray | float, **about: Any,
    ) -> Self:  # fmt: skip
        """Return those of the components (k, c) of k owners, with names and units (c,), which are unknown.

        `given`, `sigma` and `effect` are of all, (k, c); the others are as the class has them.
        """
        owner, component = (rows.tolist() for rows in np.nonzero(which))
        return cls(
            noun=noun,
            owner=tuple(owners[owner].tolist()),
            parameter=tuple(names[row] for row in component),
            unit=tuple(units[row] for row in component),
            given=given[which],
            weight=inverse_squares(sigma[which]),
            effect=np.broadcast_to(effect, which.shape)[which],
            **about,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each."""
        pairs = zip(self.parameter, self.owner, strict=True)
        return tuple(f"{parameter} of {self.noun} {owner}" for parameter, owner in pairs)

    def weighted(self, factor: FloatArray | float) -> Self:
        """Return the same with the weights times `factor`."""
        return replace(self, weight=self.weight * factor)


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraParameters(Parameters):
    """Those of c cameras, k of each, of which some are unknown: camera by camera."""

    camera: IntArray  # (n,) of each photo
    held: FloatArray  # (c, k) values as given, of the unknown ones too
    unknown: BoolArray  # (c, k)

    @classmethod
    def of_cards(
        cls, block: Block, names: Sequence[str], units: Sequence[str], held: FloatArray,
        effect: Callable[[FloatArray], FloatArray], **about: Any,
    ) -> Self:  # fmt: skip
        """Return parameters whose values are `held` (c, k) where CAL cards give no other ones."""
        table, held = block.lens_unknowns.of(names), held.copy()
        unknown, sigma = np.zeros(held.shape, dtype=bool), np.full(held.shape, np.nan)
        at = table.camera, np.array([names.index(name) for name in table.parameter.tolist()], dtype=int)
        held[at] = np.where(np.isnan(table.value), held[at], table.value)
        unknown[at], sigma[at] = True, table.sigma
        about |= {"camera": block.photos.camera, "held": held, "unknown": unknown}
        return cls.of_components(
            "camera", block.cameras.ids, names, units, unknown, held, sigma, effect(held),
            effect_in=Effect.IMAGE, rest=_REST, **about,
        )  # fmt: skip

    def table(self, values: FloatArray) -> FloatArray:
        """Return all parameters (c, k) at `values` (x,) of the unknown ones."""
        table = self.held.copy()
        table[self.unknown] = values
        return table


def adjusted_parameters(
    network: Network,
    state: State,
    known: Covariances,
    name: Callable[[int], str],
    mean_depth: FloatArray | None,
    motions: FloatArray,
    camera: tuple[float, float, float],
) -> AdjustedParameters | None:
    """Return the further parameters of a solution, None where there are none.

    `name` names the unknowns of the normal equations; `mean_depth` (u + 1,) has their cofactors with the mean depth
    of submerged points, then its own. `camera`: the sigma of images and the focal length in mm, the flying height.

    What the free `motions` (u, d) of a block change is not determined. All else is judged by how far a sigma, with
    the a priori unit weight, turns rays and so moves the ground, be it of lenses, angles or places. Up to `_MOST`
    sigmas of an image the observations determine it; beyond, a prior with a sigma up to `_INFORMATIVE` knows it.
    """
    kinds = [kind for kind in network.parameters if network.border.count(kind)]
    if not kinds:
        return None
    every = [network.parameters[kind] for kind in kinds]
    counts = [len(of.given) for of in every]
    columns = np.concatenate([network.border.numbers(kind) for kind in kinds])
    weight, effect = (np.concatenate([getattr(of, name) for of in every]) for name in ("weight", "effect"))
    cofactor, covariance = (
        np.diagonal(known.cofactors.corner)[columns],
        known.unknowns.corner[np.ix_(columns, columns)],
    )
    inflation = cofactor * known.diagonal.border[columns]
    plate_sigma, f, height = camera
    turn = {Effect.IMAGE: 1.0 / f, Effect.ANGLE: 1.0, Effect.PLACE: 1.0 / height}
    angle = effect * np.repeat([turn[of.effect_in] for of in every], counts)
    moved = np.abs(motions[network.pattern.order + columns]) > _MOVED * np.abs(motions).max(axis=0, initial=0.0)
    tied, correlation = _ties(network, known.cofactors, columns, name, mean_depth)
    with np.errstate(divide="ignore"):
        prior_sigma = np.where(weight > 0.0, 1.0 / np.sqrt(weight), np.nan)
    most = _MOST * plate_sigma / f / angle
    determined = (np.sqrt(cofactor) <= most) | (prior_sigma * angle <= _INFORMATIVE)
    return AdjustedParameters(
        kind=np.repeat([int(kind) for kind in kinds], counts),
        noun=np.repeat([of.noun for of in every], counts),
        owner=_texts(of.owner for of in every),
        parameter=_texts(of.parameter for of in every),
        unit=_texts(of.unit for of in every),
        given=np.concatenate([of.given for of in every]),
        prior_sigma=prior_sigma,
        value=np.concatenate([state.parameters[kind] for kind in kinds]),
        spread=np.where(moved.any(axis=1), np.inf, np.sqrt(np.diagonal(covariance))),
        kept=np.sqrt(cofactor) / prior_sigma,
        inflation=np.where(inflation > 0.0, inflation, np.nan),
        determined=determined & ~moved.any(axis=1),
        most=most,
        effect=np.where(np.repeat([of.effect_in is Effect.IMAGE for of in every], counts), effect, np.nan),
        tied=tied,
        correlation=correlation,
        products=covariance.reshape(-1),
    )


def _texts(parts: Iterable[Sequence[str]]) -> TextArray:
    return np.array([text for part in parts for text in part], dtype=np.str_)


def _ties(
    network: Network,
    cofactors: Cofactors,
    columns: IntArray,
    name: Callable[[int], str],
    mean_depth: FloatArray | None,
) -> tuple[TextArray, FloatArray]:
    """Return the names (x, 4) and correlations (x, 5) of what the parameters in `columns` (x,) are tied to most."""
    n, q, x = network.photos, network.pattern.size, len(columns)
    variance, numbers = cofactors.diagonal(), np.arange(n * q + network.border.size)
    rows = np.concatenate([cofactors.border[:, columns], cofactors.corner[:, columns]])
    own = numbers[n * q + columns]
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.clip(
            np.nan_to_num(rows / np.sqrt(variance[:, None] * variance[own]), posinf=0.0, neginf=0.0), -1.0, 1.0
        )
    value[own, np.arange(x)] = 0.0
    component = np.where(numbers < n * q, numbers % q, q)
    is_parameter = np.isin(numbers, own)
    groups = (is_parameter, component < 3, (3 <= component) & (component < 6), (component >= 6) & ~is_parameter)
    tied, correlation = np.full((x, 4), "", dtype=object), np.full((x, len(TIES)), np.nan)
    for group, rows_of in enumerate(map(np.flatnonzero, groups)):
        if not len(rows_of):
            continue
        best = rows_of[np.round(np.abs(value[rows_of]), _DECIMALS).argmax(axis=0)]  # the first of equal ones
        for row in np.flatnonzero(value[best, np.arange(x)]).tolist():
            tied[row, group], correlation[row, group] = name(int(best[row])), value[best[row], row]
    if mean_depth is not None:
        correlation[:, -1] = mean_depth[own] / np.sqrt(mean_depth[-1] * variance[own])
    return tied.astype(np.str_), correlation
