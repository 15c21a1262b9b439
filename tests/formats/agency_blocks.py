"""Blocks of every coordinate system with random values, of which other agencies' files hold parts."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from formats.deck_edits import in_system
from musatpy.formats import musat
from musatpy.model import Block, CoordinateSystem, FiducialMeasurements


def random_job(seed: int, system: CoordinateSystem) -> Block:
    """Return the good deck's block with attitudes of any size, sigmas here and there, and a principal point."""
    rng = np.random.default_rng(seed)
    block = in_system(system)
    photos, plates, control = block.photos, block.plates, block.control
    attitude = rng.uniform([-1.2, -1.2, -np.pi], [1.2, 1.2, np.pi], photos.attitude.shape)
    moved = photos.position + rng.normal(0.0, 1e-6, photos.position.shape)
    return replace(
        block,
        cameras=replace(block.cameras, principal_point=rng.uniform(-0.05, 0.05, (1, 2)).round(5)),
        photos=replace(
            photos, position=moved, attitude=attitude, position_sigma=some(rng, 0.5, photos.position.shape)
        ),
        plates=replace(
            plates, xy=plates.xy + rng.normal(0.0, 0.1, plates.xy.shape), sigma=some(rng, 0.005, plates.sigma.shape)
        ),
        control=replace(control, sigma=rng.uniform(0.05, 0.5, control.sigma.shape)),
    )


def some(rng: np.random.Generator, scale: float, shape: tuple[int, ...]) -> np.ndarray:
    """Return standard deviations for some rows, none for the others."""
    return np.where(rng.random((shape[0], 1)) < 0.5, np.nan, scale * rng.uniform(0.5, 2.0, shape))


def with_marks(block: Block, count: int) -> Block:
    """Return the block with `count` fiducial measurements on each photo, whole micrometres."""
    n = len(block.photos.ids)
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    xy = (np.stack([np.cos(around), np.sin(around)], axis=1) * 106.0).round(3)
    marks = FiducialMeasurements(
        photo=np.repeat(np.arange(n), count),
        ids=np.tile(np.arange(1, count + 1).astype(str), n),
        xy=np.tile(xy, (n, 1)),
        sigma=np.full((n * count, 2), np.nan),
    )
    return replace(block, fiducial_measurements=marks, plates=replace(block.plates, xy=block.plates.xy.round(3)))


def deck_of(block: Block, folder: Path) -> Path:
    """Return a written deck of the block."""
    path = folder / "given.crd"
    musat.write_deck(block, path)
    return path
