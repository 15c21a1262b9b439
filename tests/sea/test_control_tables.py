"""Control points out of decks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from musatpy import read_deck
from musatpy.errors import CollocationError
from musatpy.geometry.systems import LocalRectangular
from musatpy.model import ControlKind, CoordinateSystem
from musatpy.sea.interpolation.control_tables import control_of, deck_control

DECK = Path(__file__).parents[2] / "fixtures" / "cayman" / "cayman_modified.crd"


def test_the_check_points_under_water_of_a_deck_are_control() -> None:
    block = read_deck(DECK)
    count = len(block.control.point)
    wet = block.points.bathymetric.copy()
    wet[block.control.point] = [row != 1 for row in range(count)]
    kind = np.full(count, ControlKind.CHECK)
    kind[0] = ControlKind.FULL
    position = np.arange(3.0 * count).reshape(count, 3)
    position[2, 2] = np.nan
    sigma = np.full((count, 3), np.nan)
    sigma[3] = 0.5
    block = replace(
        block,
        options=replace(block.options, system=CoordinateSystem.LOCAL),
        points=replace(block.points, bathymetric=wet),
        control=replace(block.control, kind=kind, position=position, sigma=sigma),
    )
    found = deck_control(block, "job.crd", LocalRectangular())
    ids = block.points.ids[block.control.point].tolist()
    assert [row.id for row in found.rows] == ids[3:]  # not the full one, the dry one, the one without a height
    assert found.needs_mapped
    assert found.rows[0].numbers == {"z_true": 11.0, "sigma": 0.5}
    control = control_of(found, dict.fromkeys(ids, (1.0, 2.0, 10.0)), "mapped.csv", default_sigma=0.2)
    assert control.observed.value[0] == -1.0
    assert control.observed.sigma.tolist() == [0.5, *[0.2] * (len(ids) - 4)]
    block = replace(block, control=replace(block.control, kind=np.full(count, ControlKind.FULL)))
    with pytest.raises(CollocationError, match="no check point under water has a height"):
        deck_control(block, "job.crd", LocalRectangular())
