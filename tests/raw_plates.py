"""Raw plates for the tests: what a comparator would have read of a refined block, by the inverse of the reduction.

`python tests/raw_plates.py` writes the deck of fixtures/st_thomas_raw again. A test holds the file to it.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from musatpy import model
from musatpy.formats import musat
from musatpy.reduction.planar import solve
from musatpy.reduction.plate_steps import Step
from musatpy.reduction.refined_block import reduction_of
from musatpy.units import ARC_SECOND, DEGREE, MICROMETRE

FIXTURES = Path(__file__).parents[1] / "fixtures"
DECK = FIXTURES / "st_thomas_raw" / "st_thomas_raw.crd"

MARKS = {
    "1": (106.003, 105.998),
    "2": (-106.001, 106.004),
    "3": (-105.997, -106.002),
    "4": (106.002, -105.996),
    "5": (112.004, 0.002),
    "6": (-0.003, 111.998),
    "7": (-112.001, -0.001),
    "8": (0.002, -112.003),
}
COMPARATOR = model.ComparatorSpec(
    scale_u=0.999985,
    scale_v=1.000021,
    non_orthogonality=14.5 * ARC_SECOND,
    rotation=-90.0 * DEGREE,
    left_handed=True,
    reading_sigma=0.002,
    repeat_limit=0.010,
)
# How the film of each photo lies: shrinkage of a thousandth, a shear, a turn, and its place on the stage, mm.
FILMS = {
    "21": np.array([[0.99921, 0.00342], [-0.00335, 0.99884]]),
    "22": np.array([[0.99934, -0.00561], [0.00569, 0.99901]]),
    "23": np.array([[0.99907, 0.00123], [-0.00104, 0.99876]]),
}
PLACE = np.array([131.2, 127.9])


def refined_block() -> model.Block:
    """Return the block of St. Thomas."""
    return musat.read_deck(FIXTURES / "st_thomas" / "st_thomas.crd")


def before(step: Step, xy: np.ndarray) -> np.ndarray:
    """Return the points (m, 2) that a step of the reduction takes to points xy (m, 2), by Newton's method."""
    at = xy
    for _ in range(10):
        at = at - solve(step.partials(at), step.apply(at) - xy)
    return at


def raw_block(block: model.Block | None = None, **changes: object) -> model.Block:
    """Return a block as a comparator would have read it; `changes` are of its calibrations and options.

    Marks, and the first point of each photo, are read twice. The readings of the marks have errors of 3 um; those
    of the points have none but those of the block, so that the refined coordinates come back.
    """
    block = block or refined_block()
    rng = np.random.default_rng(1834)
    block = with_calibrations(block, rng)
    block = replace(block, **changes)
    rows, xy = [], []
    for photo, plate in enumerate(reduction_of(block)):
        own = np.flatnonzero(block.plates.photo == photo)
        readings = block.plates.xy[own]
        for applied in reversed(plate.steps):
            readings = before(applied.step, readings)
        spread = np.zeros_like(readings)
        spread[0] = rng.normal(0.0, 2.0 * MICROMETRE, 2)
        rows += [own, own[:1]]
        xy += [readings + spread, readings[:1] - spread[:1]]
    row, readings = np.concatenate(rows), np.concatenate(xy)
    plates = block.plates
    return replace(
        block,
        plates=model.PlateMeasurements(
            photo=plates.photo[row],
            point=plates.point[row],
            xy=readings,
            sigma=plates.sigma[row],
            triangulated=plates.triangulated[row],
        ),
    )


def with_calibrations(block: model.Block, rng: np.random.Generator) -> model.Block:
    """Return the block with the calibrations of camera and comparator, the options, and readings of the marks."""
    comparator = COMPARATOR
    ids, xy = np.array(list(MARKS)), np.array(list(MARKS.values()))
    q, photos = len(ids), block.photos.ids.tolist()
    matrix = np.linalg.inv(reduction_matrix(comparator))
    readings = [
        (xy @ film_of(photo).T + PLACE + rng.normal(0.0, 3.0 * MICROMETRE, xy.shape)) @ matrix.T for photo in photos
    ]
    again = [one + rng.normal(0.0, 2.0 * MICROMETRE, xy.shape) for one in readings]
    return replace(
        block,
        titles=(f"{block.titles[0][:50]} RAW PLATES",),
        reduction=model.ReductionOptions(
            plates=model.Plates.RAW,
            residual_limit=30.0 * MICROMETRE,
            side=model.DistortionSide.IDEAL,
            polynomials=model.Polynomials.CORRECTION,
            atmosphere=model.Atmosphere.US1976,
            ground_height=20.0,
        ),
        comparator=comparator,
        fiducials=model.Fiducials(camera=np.zeros(q, dtype=int), ids=ids, xy=xy, sigma=np.full((q, 2), 0.002)),
        fiducial_measurements=model.FiducialMeasurements(
            photo=np.repeat(np.arange(len(photos)), 2 * q),
            ids=np.tile(ids, 2 * len(photos)),
            xy=np.concatenate([part for pair in zip(readings, again, strict=True) for part in pair]),
            sigma=np.full((2 * q * len(photos), 2), np.nan),
        ),
        lenses=model.Lenses(
            camera=np.zeros(1, dtype=int),
            centre=np.array([[0.012, -0.004]]),
            k0=np.array([-2.4e-5]),
            zero_radius=np.array([np.nan]),
        ),
        distortion=model.Distortion(
            camera=np.zeros(5, dtype=int),
            kind=np.array(["RADL", "DCEN", "TABL", "TABL", "TABL"]),
            values=np.array(
                [
                    [3.1e-9, -1.2e-13, np.nan],
                    [1.5e-7, -0.8e-7, np.nan],
                    [50.0, 0.002, np.nan],
                    [100.0, -0.001, np.nan],
                    [150.0, -0.004, np.nan],
                ]
            ),
        ),
    )


def distances() -> model.MarkDistances:
    """Return four calibrated distances between the marks, two of them along the axes."""
    ends = [("7", "5"), ("8", "6"), ("3", "1"), ("4", "2")]
    return model.MarkDistances(
        camera=np.zeros(4, dtype=int),
        marks=np.array(ends),
        distance=np.array([np.hypot(*np.subtract(MARKS[a], MARKS[b])) for a, b in ends]).round(5),
        sigma=np.full(4, 0.003),
        axis=np.array(["X", "Y", "", ""]),
    )


def reseau() -> model.ReseauCrosses:
    """Return a reseau of 7 by 7 crosses, 38 mm apart."""
    row, column = (places.ravel() for places in np.indices((7, 7)))
    rng = np.random.default_rng(7)
    xy = np.stack([38.0 * (column - 3), 38.0 * (3 - row)], axis=1) + rng.normal(0.0, 2.0 * MICROMETRE, (49, 2))
    return model.ReseauCrosses(
        camera=np.zeros(49, dtype=int),
        ids=np.array([f"{'ABCDEFG'[i]}{j + 1:02d}" for i, j in zip(row, column, strict=True)]),
        row=row + 1.0,
        column=column + 1.0,
        xy=xy.round(5),
    )


def crosses(photos: list[str]) -> model.CrossMeasurements:
    """Return one reading of each cross on each photo; the film is deformed by up to 0.02 mm."""
    known, readings = reseau(), []
    x, y = known.xy.T / 110.0
    bent = known.xy + 0.01 * np.stack([x * y + x, y**2 - x], axis=1)
    matrix = np.linalg.inv(reduction_matrix(COMPARATOR))
    for photo in photos:
        readings.append((bent @ film_of(photo).T + PLACE) @ matrix.T)
    return model.CrossMeasurements(
        photo=np.repeat(np.arange(len(photos)), 49),
        ids=np.tile(known.ids, len(photos)),
        xy=np.concatenate(readings),
    )


def reduction_matrix(spec: model.ComparatorSpec) -> np.ndarray:
    """Return the matrix from readings to plate millimetres, written out (docs/reduction.md)."""
    sin, cos = np.sin(spec.non_orthogonality), np.cos(spec.non_orthogonality)
    h = -1.0 if spec.left_handed else 1.0
    rails = np.array([[spec.scale_u, h * spec.scale_v * sin], [0.0, h * spec.scale_v * cos]])
    turn = np.array(
        [[np.cos(spec.rotation), -np.sin(spec.rotation)], [np.sin(spec.rotation), np.cos(spec.rotation)]]
    )
    return np.asarray(turn @ rails)


def film_of(photo: str, films: Mapping[str, np.ndarray] = FILMS) -> np.ndarray:
    """Return the linear part of how a film lies, that of the first photo for photos that have none."""
    return films.get(photo, films["21"])


def main() -> None:
    """Write the deck of the fixture."""
    DECK.parent.mkdir(exist_ok=True)
    musat.write_deck(raw_block(), DECK)


if __name__ == "__main__":
    main()
