"""Models through water against free networks of IIIA whose plane of water is unknown, and what holds these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import musatpy
from musatpy.adjustment.water_surface import level_motions, moved_level, slope_motions, turned_slope
from musatpy.geometry.similarity import fit
from musatpy.model import Datum, ObservationKind
from musatpy.orientation.twomedia.oriented import orient
from musatpy.orientation.twomedia.sights import Plane
from orientation.twomedia.geometries import geometry, sights_of
from orientation.twomedia.methods import METHODS
from orientation.twomedia.referee import block_of
from orientation.twomedia.test_methods import noisy


@pytest.mark.parametrize("method", ["PAIR-INDEPENDENT", "PAIR-SUCCESSIVE", "TRIPLET"])
def test_a_model_is_a_free_network_with_an_unknown_plane(method: str) -> None:
    """Points to 1e-6 of their sigmas after a similarity, squares and redundancy numbers to 1e-9."""
    true = geometry("lab", method)
    sights = noisy(sights_of(true), 1)
    result = orient(sights, METHODS[method], Plane(), true.kind.B)
    block = block_of(true, sights, result.at)
    solution = musatpy.adjust(replace(block, options=replace(block.options, datum=Datum.FREE)))
    assert solution.observations["inner constraints"] == 7
    assert solution.degrees_of_freedom == result.redundancy
    assert solution.sum_of_squares == pytest.approx(result.adjusted.squares[0], rel=1e-9)
    similarity = fit(solution.points.position, result.points, np.ones(len(result.points)))
    off = similarity.apply(solution.points.position) - result.points
    sigma = np.sqrt(np.diagonal(result.point_covariance(), axis1=1, axis2=2))
    assert np.abs(off / sigma).max() < 1e-6
    assert solution.observed is not None
    plates = solution.observed.kind == ObservationKind.PLATE
    numbers = solution.observed.redundancy[plates].reshape(-1, 2)
    np.testing.assert_allclose(numbers, result.image_redundancy, atol=1e-9)


@pytest.mark.parametrize("motion", range(7))
def test_the_plane_of_water_moves_with_the_block(motion: int) -> None:
    """Finite motions against their rates: central differences of 1e-5, whose third derivatives are 1e-10."""
    slope, above, place, step = np.array([0.3, -0.2]), np.array([-1.5, -1.3]), np.array([0.7, 2.1]), 1e-5
    moves = np.eye(7)[motion] * np.array([[step], [-step]])
    levels = [moved_level(above, slope, place, move, True) for move in moves]
    slopes = [turned_slope(slope, move) for move in moves]
    np.testing.assert_allclose(
        (levels[0] - levels[1]) / (2 * step), level_motions(above, slope, place)[:, motion], atol=1e-9
    )
    np.testing.assert_allclose((slopes[0] - slopes[1]) / (2 * step), slope_motions(slope)[:, motion], atol=1e-9)
