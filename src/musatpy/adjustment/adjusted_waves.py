"""The unknown waves of a solution: what is known of them, on what they depend, where the deck leaves them open."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from musatpy.adjustment.iteration import LEVEL, State
from musatpy.adjustment.kinds.water import Wave
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import Cofactors
from musatpy.adjustment.propagation import Diagonal
from musatpy.adjustment.wave_search import OtherCrests, nothing_searched
from musatpy.adjustment.wavy_water import AZIMUTH, CREST, LENGTH, WorkingSea, names_of_waves
from musatpy.arrays import FloatArray
from musatpy.model import AdjustedWaves, ObservationKind
from musatpy.model.tables import finite_rows

_UP = 2  # of the unknowns of a photo


def adjusted_waves(
    network: Network,
    state: State,
    diagonal: Diagonal,
    cofactors: Cofactors,
    covariances: Cofactors,
    name: Callable[[int], str],
    crests: OtherCrests | None,
) -> AdjustedWaves | None:
    """Return the waves of a solution, None where they were known; `name` names the unknowns.

    Without `crests` nobody has looked whether there are others.
    """
    border = network.border
    if network.sea is None or network.sea.trains is None or network.sea.sea.sigma is None:
        return None
    unknown = network.sea.sea.unknown
    columns = border.at(ObservationKind.WAVE)
    cofactor = np.diagonal(cofactors.corner)[columns]

    def spread(values: FloatArray) -> FloatArray:
        out = np.full(unknown.shape, np.nan)
        out[unknown] = values
        return out

    pairs = list(_correlations(network, cofactors, name))
    crests = crests or nothing_searched(len(unknown))
    return AdjustedWaves(
        ids=np.array(names_of_waves(network.sea.sea)),
        value=state.waves,
        prior=network.sea.waves,
        prior_sigma=network.sea.sea.sigma,
        sigma=spread(np.sqrt(np.diagonal(covariances.corner)[columns])),
        kept=spread(np.sqrt(cofactor * Wave().weight(network))),
        inflation=spread(cofactor * diagonal.border[columns]),
        speed=network.sea.trains.with_values(state.waves).speed,
        open=_open(network.sea, _reach(network, state, network.sea)),
        rival=crests.rival,
        excess=crests.excess,
        searched=crests.searched,
        first=np.array([first for first, _, _ in pairs], dtype=np.str_),
        second=np.array([second for _, second, _ in pairs], dtype=np.str_),
        correlation=np.array([value for _, _, value in pairs]),
    )


def _reach(network: Network, state: State, sea: WorkingSea) -> float:
    """Return the RMS distance (m) of the points that are seen through the waves from their origin."""
    wet = np.zeros(network.points, dtype=bool)
    wet[network.point[network.refracted]] = True
    ground = state.ground[wet & finite_rows(state.ground)]
    plan = (ground - sea.origin) @ sea.axes[:2].T
    return float(np.sqrt(np.mean(np.sum(np.square(plan), axis=1)))) if len(ground) else 0.0


def _open(sea: WorkingSea, reach: float) -> FloatArray:
    """Return by how much of its length (k,) the sigmas of a wave shift its crests at a distance (m)."""
    L, sigma = sea.waves[:, LENGTH], np.nan_to_num(np.asarray(sea.sea.sigma)).T
    return np.hypot.reduce([reach * sigma[LENGTH] / L**2, reach * sigma[AZIMUTH] / L, sigma[CREST] / L])


def _correlations(
    network: Network, cofactors: Cofactors, name: Callable[[int], str]
) -> Iterator[tuple[str, str, float]]:
    """Yield names and correlations of wave parameters with one another, the water, and one height of a station.

    Of station heights, and of water levels where each photo has its own, the one most correlated stands for all.
    """
    border, n, q = network.border, network.photos, network.pattern.size
    corner = cofactors.corner
    scale = np.sqrt(np.diagonal(corner))
    photo = np.sqrt(np.einsum("nii->ni", cofactors.of_single_photos()))
    edge = cofactors.border.reshape(n, q, -1)
    first_water, waves = border.at(ObservationKind.WATER_LEVEL).start, border.numbers(ObservationKind.WAVE).tolist()
    for number, column in enumerate(waves):
        parameter = name(n * q + column)
        for other in (*waves[number + 1 :], *range(first_water, waves[0])):
            yield parameter, name(n * q + other), float(corner[column, other] / (scale[column] * scale[other]))
        for row in (_UP, *((LEVEL,) if network.water.per_photo else ())):
            with np.errstate(invalid="ignore"):
                correlations = np.nan_to_num(edge[:, row, column] / (photo[:, row] * scale[column]))
            strongest = int(np.argmax(np.round(np.abs(correlations), 9)))
            yield parameter, name(strongest * q + row), float(correlations[strongest])
