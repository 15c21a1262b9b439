"""`musat orient` without any water: relative orientation; and what nothing determines from the air."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from json_schema import violations
from musatpy.arrays import FloatArray
from musatpy.cli.main import main as musat
from musatpy.geometry.rotations import attitude_matrix
from musatpy.orientation.twomedia.rays import Orientation
from musatpy.reports import orientation
from orientation.twomedia.geometries import KINDS, dry, geometry, scene
from orienting.decks import deck_block
from orienting.test_orient import orient, record, written
from record_rows import with_columns

AERIAL = Path(__file__).parents[2] / "fixtures" / "trust" / "aerial_single_no_start.crd"


def dry_pair(folder: Path, method: str, seed: int = 1, noise: float = 5e-6) -> tuple[Path, Orientation]:
    """Write the deck of an aerial pair all of whose points stand above the water, and return it with the truth."""
    wet = geometry("aerial", "PAIR-INDEPENDENT")
    points = dry(KINDS["aerial"], wet.points, len(wet.points))
    true = scene(wet.kind, points, wet.stations, wet.angles)
    block, truth, _ = deck_block("aerial", method, 0, true=true, seed=seed, noise=noise)
    return written(folder, replace(block, water=None)), truth


def turned(attitude: FloatArray) -> FloatArray:
    """Return the rotation from the first photo to the second."""
    first, second = attitude_matrix(attitude)
    return np.asarray(second @ first.T)


@pytest.mark.parametrize("method", ["PAIR-INDEPENDENT", "PAIR-SUCCESSIVE"])
def test_a_pair_without_water_is_the_relative_orientation(method: str, tmp_path: Path) -> None:
    """Five unknowns, no plane; rotation and base are those that the images were made with."""
    deck, truth = dry_pair(tmp_path, method, noise=0.0)
    result = orient(deck, "--punch")
    assert result.exit_code == 0, result.output
    assert (
        f"{method} of 0, 1, sigma0 0.0" in result.stdout and "no point under water: straight rays" in result.stdout
    )
    values, schema = record(deck), orientation.schema()
    assert not list(violations(with_columns(values, schema), schema, schema))
    assert values["plane"] is None and values["fit"]["redundancy"] == 15
    assert all(row["depth"] is None for row in values["points"])
    attitude = np.array([row["attitude"] for row in values["stations"]])
    # Plate coordinates have seven decimals of a millimetre: 3e-10 of an angle, which the geometry makes ten times.
    np.testing.assert_allclose(turned(attitude), turned(truth.attitude[0]), rtol=0, atol=1e-8)
    base = np.diff([row["position"] for row in values["stations"]], axis=0)[0] @ attitude_matrix(attitude)[0].T
    true = np.diff(truth.station[0], axis=0)[0] @ attitude_matrix(truth.attitude[0])[0].T
    np.testing.assert_allclose(base / np.linalg.norm(base), true / np.linalg.norm(true), rtol=0, atol=1e-8)
    listing = deck.with_suffix(".lst").read_text()
    assert "Unknowns, redundancy ............................. 5, 15" in listing and "Plane Of Water" not in listing


@pytest.mark.slow
def test_a_dry_pair_has_the_sigmas_of_its_errors(tmp_path: Path) -> None:
    """Errors of omega, phi, kappa of photo 2 against photo 1 over their sigmas, of eight draws: as of one sigma."""
    over = []
    for seed in range(8):
        deck, truth = dry_pair(tmp_path, "PAIR-SUCCESSIVE", seed)
        assert orient(deck, "-q").exit_code == 0
        row = record(deck)["stations"][1]
        errors = turned(truth.attitude[0]).T @ attitude_matrix(np.array(row["attitude"]))
        # photo 1 stands in its own axes; small angles between both second photos
        angles = 0.5 * np.array(
            [errors[1, 2] - errors[2, 1], errors[2, 0] - errors[0, 2], errors[0, 1] - errors[1, 0]]
        )
        over.append(np.linalg.norm(angles) / np.linalg.norm(row["attitude_sigma"]))
    assert 0.5 < np.sqrt(np.mean(np.square(over))) < 1.6


def test_a_run_starts_from_the_punched_pair_and_comes_to_the_same(tmp_path: Path) -> None:
    deck, _ = dry_pair(tmp_path, "PAIR-INDEPENDENT")
    assert orient(deck, "--punch").exit_code == 0
    (tmp_path / "again").mkdir()
    again = tmp_path / "again" / "pair.crd"
    again.write_bytes(deck.with_suffix(".pun").read_bytes())
    result = CliRunner().invoke(musat, ["run", str(again)])
    assert result.exit_code == 0, result.output
    found, fit = record(again)["solution"], record(deck)["fit"]
    squares = found["sigma0"] ** 2 * found["degrees_of_freedom"]
    assert squares == pytest.approx(fit["sigma0"] ** 2 * fit["redundancy"], rel=1e-4)


def test_other_methods_want_water(tmp_path: Path) -> None:
    block, _, _ = deck_block("lab", "TRIPLET", 0)
    dry_block = replace(block, points=replace(block.points, bathymetric=np.zeros(len(block.points.ids), bool)))
    result = orient(written(tmp_path, dry_block))
    assert result.exit_code == 1
    assert "of dry points PAIR-INDEPENDENT and PAIR-SUCCESSIVE are the relative orientation" in result.output


def test_what_the_air_does_not_determine_is_said_so(tmp_path: Path) -> None:
    """Twenty control points 24 to 70 m deep, from 3,900 m: it "did not converge from any start"."""
    result = orient(AERIAL, "-o", str(tmp_path))
    assert result.exit_code == 0 and "does not converge" not in result.output
    assert "doubtful: the plane of water is not determined: the sigma of its level is 0.548 of" in result.output
    assert "plane of water not determined (0.548 of the depth)" in result.stdout
