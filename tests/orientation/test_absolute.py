"""Absolute orientation to full and partial control, with wrong points among it."""

from __future__ import annotations

import numpy as np
import pytest

from musatpy.geometry.rotations import attitude_matrix
from musatpy.geometry.similarity import Similarity
from musatpy.orientation.absolute import Targets, absolute_orientation

TRUE = Similarity(
    scale=1800.0, rotation=attitude_matrix([0.05, -0.08, 2.0]), shift=np.array([5000.0, -3000.0, 120.0])
)
UP = TRUE.rotation.T @ [0.06, -0.04, 1.0] / np.linalg.norm([0.06, -0.04, 1.0])  # a few degrees off


def targets(known: list[str], seed: int = 1) -> Targets:
    """Return targets over a block of 12 by 8 km with little relief; F full, H horizontal, V vertical."""
    rng = np.random.default_rng(seed)
    place = rng.uniform([-6000.0, -4000.0, 0.0], [6000.0, 4000.0, 80.0], (len(known), 3))
    mask = np.array([[kind in "FH"] * 2 + [kind in "FV"] for kind in known])
    return Targets(
        model=TRUE.inverse().apply(place),
        position=np.where(mask, place, 0.0),
        known=mask,
        weight=np.ones(len(known)),
    )


@pytest.mark.parametrize("kinds", ["FFFF", "HHHVVV", "FFV", "HHHHVVVVV", "FHVVV"])
def test_exact_control_of_any_kind_gives_the_exact_similarity(kinds: str) -> None:
    found = absolute_orientation(targets(list(kinds)), UP, 10.0)
    assert found is not None
    move, _ = found
    # the level ground holds with 1/400 of a component of 10 m: a few centimetres over the arms of kilometres
    assert move.scale == pytest.approx(TRUE.scale, rel=1e-4)
    np.testing.assert_allclose(move.rotation, TRUE.rotation, atol=1e-3)
    corner = np.array([1.0, -1.0, 0.0])
    np.testing.assert_allclose(move.apply(corner), TRUE.apply(corner), atol=1.0)


@pytest.mark.parametrize("size", [30.0, 1000.0])
def test_wrong_control_is_seen(size: float) -> None:
    good = targets(["F"] * 6 + ["H"] * 3 + ["V"] * 4)
    position = good.position.copy()
    position[1, 0] += size
    position[11, 2] -= size
    wrong = Targets(model=good.model, position=position, known=good.known, weight=good.weight)
    found = absolute_orientation(wrong, UP, 1.0)
    assert found is not None
    move, robust = found
    assert robust[1, 0] < 0.1
    assert robust[11, 2] < 0.1
    assert (robust[good.known].sum(), (robust < 0.1)[good.known].sum()) > (20.0, 0)
    at = np.zeros(3)
    np.testing.assert_allclose(move.apply(at), TRUE.apply(at), atol=3.0)  # what Cauchy's weights leave of 30 m


@pytest.mark.parametrize("kinds", ["F", "HH", "VVV", "HV"])
def test_too_little_control_gives_nothing(kinds: str) -> None:
    assert absolute_orientation(targets(list(kinds)), UP, 10.0) is None
