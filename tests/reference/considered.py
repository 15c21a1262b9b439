"""Errors of parameters that are known by a sigma and not adjusted, in the covariances of the dense bundle."""

from dataclasses import dataclass, replace

import numpy as np

from musatpy.model import Block, Solution, WaterLevel
from reference.compare import beside
from reference.dense_bundle import Network, State, starting_state


def state_of(network: Network, solution: Solution) -> State:
    """Return where a solution stands: corrections of tides that it does not adjust are nought."""
    state, water = starting_state(network, beside(solution)), solution.water
    known = solution.block.options.water_level is WaterLevel.KNOWN
    tides = state.tides if known else np.array(water.correction)
    return replace(state, levels=solution.levels, tides=tides, tilt=np.array(water.tilt), index=water.index)


def cofactors(J: np.ndarray) -> np.ndarray:
    """Return (J'J)^-1."""
    scale = 1.0 / np.linalg.norm(J, axis=0)
    return np.asarray(np.linalg.inv((J * scale).T @ (J * scale)) * np.outer(scale, scale))


@dataclass(frozen=True, kw_only=True)
class Joint:
    """Covariance of all unknowns and considered parameters of a network, in the order of its `part`."""

    covariance: np.ndarray
    network: Network
    state: State
    unit_sigma: float

    def sigma(self, name: str, *shape: int) -> np.ndarray:
        """Standard deviations of one kind."""
        return np.sqrt(np.diag(self.covariance)[self.network.part[name]]).reshape(*shape)

    def depth_sigmas(self) -> np.ndarray:
        """Standard deviations (p,) of the mean water over each point minus its height; photos that see it."""
        steps = 1e-3 * np.eye(self.network.size)
        there, back = (
            [self._depths(self.network.moved(self.state, way * h)) for h in steps] for way in (1.0, -1.0)
        )
        gradient = (np.array(there) - np.array(back)).T / 2e-3
        return np.sqrt(np.einsum("pi,ij,pj->p", gradient, self.covariance, gradient))

    def _depths(self, state: State) -> np.ndarray:
        plates, photos = self.network.block.plates, self.network.block.photos
        tides = photos.tide + np.append(state.tides, 0.0)[self.network.tide_group]
        sums = np.bincount(plates.point, weights=tides[plates.photo], minlength=len(state.ground))
        level = sums / np.bincount(plates.point, minlength=len(state.ground))
        return level + (state.ground[:, :2] - self.network.middle) @ state.tilt - state.ground[:, 2]


def considered(wide: Block, solution: Solution, sigma: dict[str, np.ndarray], squares: float, dof: int) -> Joint:
    """Return the joint covariance at a solution of a local block all of whose water `wide` makes unknown.

    `sigma` gives those of the considered parameters of a kind (tides, tilt, index); such a kind is not estimated
    and not observed. The adjustment has `dof` degrees of freedom and the weighted sum of squares `squares`: not
    quite that of the bundle where it corrects images.
    """
    network = Network(wide, refraction=True)
    state = state_of(network, solution)
    known = np.concatenate([*(np.arange(network.size)[network.part[name]] for name in sigma), np.zeros(0, int)])
    C = np.square(np.concatenate([*sigma.values(), np.zeros(0)]))
    J, v = network.jacobian(state), network.misclosures(state)
    # the observations of what is considered are no observations
    lone = ((J != 0.0).sum(axis=1) == 1) & (J[:, known] != 0.0).any(axis=1)
    J, v = J[~lone], v[~lone]
    free = np.setdiff1d(np.arange(network.size), known)
    A, B = J[:, free], J[:, known]
    inverse = cofactors(A)
    S = -inverse @ (A.T @ B)
    # generalised least squares has the errors of the parameters among those of the observations
    weights = (np.eye(len(v)), np.linalg.inv(np.eye(len(v)) + (B * C) @ B.T))
    plain, generalised = (_least_squares(weight, A / np.linalg.norm(A, axis=0), v) for weight in weights)
    variance = (squares - plain + generalised) / dof
    joint = np.zeros((network.size, network.size))
    joint[np.ix_(free, free)] = variance * inverse + (S * C) @ S.T
    joint[np.ix_(free, known)] = S * C
    joint[np.ix_(known, free)] = (S * C).T
    joint[np.ix_(known, known)] = np.diag(C)
    return Joint(covariance=joint, network=network, state=state, unit_sigma=float(np.sqrt(variance)))


def _least_squares(weight: np.ndarray, A: np.ndarray, v: np.ndarray) -> float:
    """The least sum of squares v' P v with unknowns of the partials A."""
    left = v - A @ np.linalg.solve(A.T @ weight @ A, A.T @ weight @ v)
    return float(left @ weight @ left)
