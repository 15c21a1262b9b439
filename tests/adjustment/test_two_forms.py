"""The normal equations of pass points in two forms: their own conditions (IIA), and their elimination (IIIA).

At adjusted images both are one, an identity (docs/theory.md, Weights): so IIA and IIIA prove each other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from altered import with_options
from musatpy import read_deck
from musatpy.adjustment import adjust, triangulation
from musatpy.adjustment.collinear import add_collinear, eliminate, reduced
from musatpy.adjustment.ground import settle
from musatpy.adjustment.network import Network
from musatpy.adjustment.normals import NormalEquations
from musatpy.adjustment.sightings import image_coordinates
from musatpy.adjustment.triangulation import Triangulation, fully_weighted
from musatpy.adjustment.unknowns import State
from musatpy.model import Block, Program, Refraction, Weights

FIXTURES = Path(__file__).parents[2] / "fixtures"
SAME = 1e-9  # of a unit diagonal


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """What a triangulation was linearised at last."""

    network: Network
    state: State


@cache
def last_of(deck: str, refraction: Refraction | None) -> Seen:
    """Return the last network and state of a job by IIA; its control known in all components, in some, or held."""
    block: Block = read_deck(FIXTURES / deck)
    options = {"program": Program.IIA, "weights": Weights.FULL}
    block = with_options(block, **options, **({} if refraction is None else {"refraction": refraction}))
    seen: list[Seen] = []
    linearise = Triangulation.linearise

    def spied(self: Triangulation, state: State) -> object:
        seen.append(Seen(network=self.network, state=state))
        return linearise(self, state)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Triangulation, "linearise", spied)
        adjust(block, lambda *_: None)  # anew
    return seen[-1]


def both(network: Network, state: State) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return S and the right side of the pass points by their conditions and by elimination, scaled alike."""
    state = settle(network, settle(network, state))
    conditions, eliminated = (NormalEquations(network.pattern, network.border.size) for _ in range(2))
    for group in network.pass_groups:
        conditions.add_sums(fully_weighted(network, state, group))
        E = eliminate(network, state, group)
        add_collinear(network, group, E, reduced(network, group, E), eliminated)
    (a, rhs_a), (b, rhs_b) = conditions.finished(), eliminated.finished()
    scale = 1.0 / np.sqrt(b.diagonal())
    return (a.scaled(scale).blocks, rhs_a * scale), (b.scaled(scale).blocks, rhs_b * scale)


def differences(network: Network, state: State) -> tuple[float, float]:
    """Return the largest differences of S and of the right sides."""
    (S, rhs), (of_points, rhs_of_points) = both(network, state)
    assert np.abs(rhs).max() > 1e-3  # stations are off: there is something to compare
    return float(np.abs(S - of_points).max()), float(np.abs(rhs - rhs_of_points).max() / np.abs(rhs).max())


def off(seen: Seen, near: bool = False) -> tuple[Network, State]:
    """Return the network with stations off by decimetres; `near`: the second stands 200 m from the first."""
    network, state = seen.network, seen.state
    position = state.position + np.random.default_rng(3).normal(0.0, 0.1, state.position.shape)
    if near:
        position[1] = position[0] + [200.0, 0.0, 0.0]
        attitude = state.attitude.copy()
        attitude[1] = attitude[0]
        state = replace(state, attitude=attitude)
        rows, xy = np.flatnonzero(network.photo == 1), network.xy.copy()
        ground = state.ground[network.point[rows]]
        xy[rows] = image_coordinates(network, replace(state, position=position), rows, ground)
        network = replace(network, xy=xy + np.random.default_rng(4).normal(0.0, 1e-3, xy.shape))
    return network, replace(state, position=position)


MODES = [
    ("st_thomas/st_thomas.crd", Refraction.NONE),
    ("st_thomas/st_thomas.crd", Refraction.LEGACY),
    ("st_thomas/st_thomas.crd", Refraction.WATPT),
    ("st_thomas/st_thomas.crd", Refraction.RIGOROUS),
    ("cayman/cayman_modified.crd", Refraction.RIGOROUS),
    ("waves/strip.crd", None),
]


@pytest.mark.parametrize(
    ("deck", "refraction", "near"),
    # nearly parallel rays through waves go by other crests than their images
    [(*mode, near) for mode in MODES for near in (False, True) if not near or mode[1] is not None],
)
def test_conditions_and_elimination_have_the_same_normal_equations(
    deck: str, refraction: Refraction | None, near: bool
) -> None:
    """With control, with points that are known in part, and with rays that are nearly parallel."""
    of_S, of_rhs = differences(*off(last_of(deck, refraction), near))
    assert of_S < SAME and of_rhs < SAME


@pytest.mark.parametrize("name", ["coplanarity", "scale_restraint"])
@pytest.mark.parametrize(("ray", "column"), [(0, 0), (1, 2), (1, 4)])
@pytest.mark.parametrize("refraction", [Refraction.NONE, Refraction.RIGOROUS])
def test_a_sign_that_is_turned_is_seen(
    monkeypatch: pytest.MonkeyPatch, name: str, ray: int, column: int, refraction: Refraction
) -> None:
    """Of the partials by a coordinate of an origin, or of a direction; values are 0 at adjusted images."""
    right = getattr(triangulation, name)

    def turned(P: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, partials = right(P, u)
        partials = partials.copy()
        partials[..., ray, column] *= -1.0
        return value, partials

    seen = last_of("st_thomas/st_thomas.crd", refraction)
    monkeypatch.setattr(triangulation, name, turned)
    assert max(differences(*off(seen))) > 1e-4
