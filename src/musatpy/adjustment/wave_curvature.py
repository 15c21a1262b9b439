"""What Gauss and Newton leave out of the normal equations of unknown waves: the second derivatives of the images.

In the effect of length, azimuth and crest the height is a factor. Of a wave that hardly shows, steps that take the
images for linear go from one side of the minimum to the other, or have to be damped to a crawl. With the second
derivatives by the waves alone, the steps are those of Newton's method in them. Those by waves and points, or
stations, are left out: these move by less than a hundredth of a length.
"""

from __future__ import annotations

import numpy as np

from musatpy.adjustment.network import Network
from musatpy.adjustment.unknowns import State
from musatpy.arrays import FloatArray
from musatpy.geometry import collinearity

_FLATTEST = 0.1  # of the curvature of the normal equations
_SHARE = 1e-5  # of the sigmas given: steps of the central differences, which lose ten digits of sixteen


def safe_curvature(curvature: FloatArray, cofactor: FloatArray) -> FloatArray:
    """Return the curvature C (w, w) so that N + C is positive definite; `cofactor` (w, w) is N^-1 of the waves.

    Against N, N + C has the eigenvalues 1 + m. Where they are below zero, or hardly above, the sum of squares
    curves down, or not at all: their sizes count then, and no less than `_FLATTEST`. So no step goes to a maximum.
    """
    L = np.linalg.cholesky(np.linalg.inv(0.5 * (cofactor + cofactor.T)))
    inner = np.linalg.solve(L, np.linalg.solve(L, curvature).T)
    m, U = np.linalg.eigh(0.5 * (inner + inner.T))
    turned = L @ U
    return (turned * (np.maximum(np.abs(1.0 + m), _FLATTEST) - 1.0)) @ turned.T


def wave_curvature(network: Network, state: State) -> FloatArray:
    """Return sum of P r times the second derivatives of the images by the unknown parameters of the waves (w, w).

    r are the residuals (adjusted minus measured) at `state`, P their weights. The waves act through their height
    and gradient at the incidence points: the partials of these by the parameters are differenced, all else stays.
    """
    if network.sea is None or network.sea.trains is None or network.sea.sea.sigma is None:
        return np.zeros((0, 0))
    rays = np.concatenate([group.rays.reshape(-1) for group in network.groups])
    rays = rays[network.refracted[rays]]
    photo, ground = network.photo[rays], state.ground[network.point[rays]]
    sea = network.sea.at(state.waves)
    bent = sea.incidence(photo, state.position[photo], ground, state.tide[photo], state.index)
    f, pp = network.focal_length[photo], network.principal_point[photo]
    xy, by_v = collinearity.image_by_vector(bent.v, state.M[photo], f, pp)
    pull = np.einsum("na,nai->ni", network.weight[rays] * (xy - network.xy[rays]), by_v)
    by_height = np.einsum("ni,ni->n", pull, bent.by_level)
    by_slope = np.einsum("ni,nia->na", pull, bent.by_slope)
    trains, unknown, time = network.sea.trains, sea.sea.unknown, sea.sea.time[photo]

    def gradient(waves: FloatArray) -> FloatArray:
        height, slope = trains.with_values(waves).by_parameters(bent.place, time)
        return by_height @ height[:, unknown] + np.einsum("na,naw->w", by_slope, slope[..., unknown])

    rows = []
    for wave, of in np.argwhere(unknown):
        step = np.zeros_like(state.waves)
        step[wave, of] = _SHARE * network.sea.sea.sigma[wave, of]
        rows.append((gradient(state.waves + step) - gradient(state.waves - step)) / (2.0 * step[wave, of]))
    matrix = np.array(rows).reshape(len(rows), len(rows))
    return 0.5 * (matrix + matrix.T)
