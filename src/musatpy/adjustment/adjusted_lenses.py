"""The unknown parameters of lenses of a solution: what is known of them, and on what they depend."""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.iteration import State
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors
from musatpy.arrays import FloatArray
from musatpy.model import LENS_PARAMETERS, AdjustedLenses, Dependence, ObservationKind


def adjusted_lenses(
    network: Network, state: State, cofactors: Cofactors, covariances: Cofactors, dependence: Dependence
) -> AdjustedLenses | None:
    """Return the lenses of a solution, None where they were held."""
    lenses = network.lenses
    if lenses is None:
        return None
    columns, unknown = network.border.at(ObservationKind.LENS), lenses.unknown
    camera, parameter = np.nonzero(unknown)
    weight, names = lenses.weight[unknown], network.border.columns[ObservationKind.LENS]
    inflation = dict(zip(dependence.names.tolist(), dependence.inflation.tolist(), strict=True))
    partner, correlation = _partners(names, dependence)
    with np.errstate(divide="ignore"):
        prior_sigma = np.where(weight > 0.0, 1.0 / np.sqrt(weight), np.nan)
    return AdjustedLenses(
        camera=np.array(lenses.ids)[camera],
        parameter=np.array(LENS_PARAMETERS)[parameter],
        given=lenses.given[unknown],
        prior_sigma=prior_sigma,
        value=state.lenses[unknown],
        spread=np.sqrt(np.diagonal(covariances.corner)[columns]),
        kept=np.sqrt(np.diagonal(cofactors.corner)[columns]) / prior_sigma,
        inflation=np.array([inflation[name] for name in names]),
        effect=lenses.effect[unknown],
        reach=lenses.reach[camera],
        partner=np.array(partner, dtype=np.str_),
        correlation=correlation,
    )


def _partners(names: tuple[str, ...], dependence: Dependence) -> tuple[list[str], FloatArray]:
    """Return which unknown of something else each of `names` is most correlated with, and how; empty: none."""
    row = {name: number for number, name in enumerate(names)}
    partner, correlation = [""] * len(names), np.full(len(names), np.nan)
    pairs = zip(dependence.first.tolist(), dependence.second.tolist(), dependence.correlation.tolist(), strict=True)
    for first, second, value in pairs:  # the strongest first
        for name, other in ((first, second), (second, first)):
            if name in row and other not in row and not partner[row[name]]:
                partner[row[name]], correlation[row[name]] = other, value
    return partner, correlation
