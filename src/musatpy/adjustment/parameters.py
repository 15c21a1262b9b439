"""Further parameters as unknowns, of cameras and lines: what is known of them beforehand, and what came out."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from musatpy.arrays import FloatArray, TextArray
from musatpy.model import AdjustedParameters, Dependence

if TYPE_CHECKING:
    from musatpy.adjustment.iteration import State
    from musatpy.adjustment.network import Network
    from musatpy.adjustment.normals import Cofactors


@dataclass(frozen=True, kw_only=True, eq=False)
class Parameters:
    """What is known beforehand of the x unknown parameters of one kind, in the order of their columns.

    The iteration ends when none of their changes has more `effect` than `rest`; a sigma of more effect than `most`
    is none. Both are of what the parameters do: millimetres in an image, metres at a station, ...
    """

    noun: str  # of what they are: `camera`
    owner: tuple[str, ...]  # (x,) ids
    parameter: tuple[str, ...]  # (x,)
    unit: tuple[str, ...]  # (x,)
    given: FloatArray  # (x,)
    weight: FloatArray  # (x,) of what is given, 0 of what is free
    effect: FloatArray  # (x,) of one unit
    rest: float
    most: FloatArray  # (x,)
    in_images: bool = False  # the effect is that on an image, in mm

    @property
    def names(self) -> tuple[str, ...]:
        """A name for each."""
        pairs = zip(self.parameter, self.owner, strict=True)
        return tuple(f"{parameter} of {self.noun} {owner}" for parameter, owner in pairs)

    def weighted(self, factor: FloatArray | float) -> Self:
        """Return the same with the weights times `factor`."""
        return replace(self, weight=self.weight * factor)


def adjusted_parameters(
    network: Network, state: State, cofactors: Cofactors, covariances: Cofactors, dependence: Dependence
) -> AdjustedParameters | None:
    """Return the further parameters of a solution, None where there are none."""
    kinds = [kind for kind in network.parameters if network.border.count(kind)]
    if not kinds:
        return None
    every = [network.parameters[kind] for kind in kinds]
    counts = [len(of.given) for of in every]
    names = [name for of in every for name in of.names]
    columns = np.concatenate([network.border.numbers(kind) for kind in kinds])
    weight, effect = (np.concatenate([getattr(of, name) for of in every]) for name in ("weight", "effect"))
    inflation = dict(zip(dependence.names.tolist(), dependence.inflation.tolist(), strict=True))
    partner, correlation = _partners(names, dependence)
    with np.errstate(divide="ignore"):
        prior_sigma = np.where(weight > 0.0, 1.0 / np.sqrt(weight), np.nan)
    return AdjustedParameters(
        kind=np.repeat([int(kind) for kind in kinds], counts),
        noun=np.repeat([of.noun for of in every], counts),
        owner=_texts(of.owner for of in every),
        parameter=_texts(of.parameter for of in every),
        unit=_texts(of.unit for of in every),
        given=np.concatenate([of.given for of in every]),
        prior_sigma=prior_sigma,
        value=np.concatenate([state.parameters[kind] for kind in kinds]),
        spread=np.sqrt(np.diagonal(covariances.corner)[columns]),
        kept=np.sqrt(np.diagonal(cofactors.corner)[columns]) / prior_sigma,
        inflation=np.array([inflation[name] for name in names]),
        most=np.concatenate([of.most for of in every]) / effect,
        effect=np.where(np.repeat([of.in_images for of in every], counts), effect, np.nan),
        partner=np.array(partner, dtype=np.str_),
        correlation=correlation,
    )


def _texts(parts: Iterable[Sequence[str]]) -> TextArray:
    return np.array([text for part in parts for text in part], dtype=np.str_)


def _partners(names: Sequence[str], dependence: Dependence) -> tuple[list[str], FloatArray]:
    """Return which unknown of something else each of `names` is most correlated with, and how; empty: none."""
    row = {name: number for number, name in enumerate(names)}
    partner, correlation = [""] * len(names), np.full(len(names), np.nan)
    pairs = zip(dependence.first.tolist(), dependence.second.tolist(), dependence.correlation.tolist(), strict=True)
    for first, second, value in pairs:  # the strongest first
        for name, other in ((first, second), (second, first)):
            if name in row and other not in row and not partner[row[name]]:
                partner[row[name]], correlation[row[name]] = other, value
    return partner, correlation
