"""What the search names on simulated strips with one cause of misfit each: the table of docs/blunders.md.

    python -m drivers.causes_study            # in tests: everything, a table of counts
    python -m drivers.causes_study control    # one part

The parts are functions that yield `Trial`s; the slow tests of the causes run a few of each.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from altered import added, altered, put, with_options
from blocks import simulation
from musatpy.errors import AdjustmentError
from musatpy.model import Block, Cause, CauseKind, Editing, Finding
from musatpy.pipeline import adjust, causes_of

SIZES = (1.0, 2.0, 5.0, 10.0, 30.0, 100.0)  # m, of wrong control
STRIPS = (6, 10, 20)  # photos
_K = CauseKind


@lru_cache(maxsize=64)
def strip(photos: int, seed: int = 1, *, observed: bool = False, wet: float = 0.3, program: str = "IIIA") -> Block:
    """Return a strip at 750 m, control of 5 cm; `observed` stations have sigmas of 10 cm."""
    stations = {"position_error": 0.1, "position_sigma": 0.1} if observed else {"position_error": 15.0}
    return simulation(
        seed,
        job={"system": "LOCL"},
        flight={"photos": photos, "height": 750.0, "attitude_scatter": 1.0, "station_scatter": 10.0},
        terrain={"relief": 30.0},
        water={"tide_scatter": 0.2},
        shoal=[{"share": wet, "depth": [1.0, 10.0]}],
        points={"per_site": 2, "extra": [{"number": 4 * photos}]},
        control=[{"kind": "full", "number": max(6, photos), "sigma": 0.05, "error": 0.05}],
        stations={**stations, "attitude_error": 0.5},
        options={"program": program, "refraction": "RIGOROUS"},
    ).block


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One deck, and what the causes of the first rank are to name of it; without kinds nothing."""

    name: str
    block: Block
    kinds: tuple[CauseKind, ...] = ()
    photos: tuple[str, ...] | None = None
    points: tuple[str, ...] | None = None
    size: float | None = None  # mm, of an error that is not edited
    may_go: np.ndarray | None = None  # (k, 3) components of control that may go out, and no image; None: any


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What EDIT says of a deck, adjusted or not."""

    causes: tuple[Cause, ...]
    findings: tuple[Finding, ...]
    edited: Block
    unedited: str


def edited(block: Block) -> Answer:
    """Return what EDIT says; where the job cannot be adjusted as it stands, that is the causes alone."""
    try:
        done = adjust(with_options(block, editing=Editing.EDIT))
    except AdjustmentError:
        return Answer(causes=causes_of(block), findings=(), edited=block, unedited="it cannot be adjusted")
    return Answer(causes=done.causes, findings=done.findings, edited=done.edited, unedited=done.unedited)


def fault(trial: Trial) -> str:
    """Return what is wrong with the answer, empty if nothing is."""
    answer = edited(trial.block)
    if not trial.kinds:
        return "" if not answer.findings and not answer.causes else f"{len(answer.findings)} findings"
    first = [cause for cause in answer.causes if cause.group == 1 and cause.rank == 1]
    of_kind = [cause for cause in first if cause.kind in trial.kinds]
    if _K.LABELS in trial.kinds:
        of_kind = of_kind[:1]
    named = [
        cause
        for cause in of_kind
        if (trial.photos is None or set(cause.photos) == set(trial.photos)) and trial.points in (None, cause.points)
    ]
    if not named:
        return f"named {[(str(cause.kind), cause.photos, cause.points) for cause in first]}"
    if trial.size is not None:
        (size, *_), (sigma, *_) = named[0].size, named[0].sigma
        if abs(size - trial.size) > max(0.05, 2.0 * sigma):
            return f"size {size:.3f} mm, sigma {sigma:.3f}"
        if not answer.unedited:
            return "edited"
    if trial.may_go is not None:
        if not (answer.edited.control.known | trial.may_go).all():
            return "innocent control out"
        if not answer.edited.plates.triangulated.all():
            return "innocent images out"
    return ""


def _nothing(block: Block) -> np.ndarray:
    return np.zeros(block.control.known.shape, dtype=bool)


def control(strips: tuple[int, ...] = STRIPS, sizes: tuple[float, ...] = SIZES) -> Iterator[Trial]:
    """Yield wrong control, up and horizontal, of a point of two and of three rays."""
    for photos in strips:
        block = strip(photos)
        seen = np.bincount(block.plates.point, minlength=len(block.points.ids))[block.control.point]
        for rays in (2, 3):
            row = int(np.flatnonzero(seen == rays)[len(np.flatnonzero(seen == rays)) // 2])
            point = str(block.points.ids[block.control.point[row]])
            for size in sizes:
                for axis, axes, kind in ((0, slice(0, 2), _K.HORIZONTAL), (2, slice(2, 3), _K.VERTICAL)):
                    yield Trial(
                        name=f"{photos} photos, {rays} rays, {size:g} m {kind}",
                        block=altered(block, control={"position": added((row, axis), size)}),
                        kinds=(kind, _K.CONTROL),
                        points=(point,),
                        may_go=put((row, axes), True)(_nothing(block)),
                    )


def exchanged(seeds: int = 3) -> Iterator[Trial]:
    """Yield photos whose plate cards, or whose station cards, bear each other's labels."""
    for seed in range(1, seeds + 1):
        for observed in (False, True):
            block = strip(10, seed, observed=observed)
            photo, position = block.plates.photo, block.photos.position
            for one, other in ((4, 5), (2, 7)):
                ids = (str(block.photos.ids[one]), str(block.photos.ids[other]))
                plates = {"photo": np.select([photo == one, photo == other], [other, one], photo)}
                stations = {"position": put([one, other], position[[other, one]])}
                for table, change in (("plates", plates), ("photos", stations)):
                    yield Trial(
                        name=f"{table} of {ids}, stations {'observed' if observed else 'approximate'}, seed {seed}",
                        block=altered(block, **{table: change}),
                        kinds=(_K.LABELS,),
                        photos=ids,
                        may_go=_nothing(block),
                    )


def focal_length(seeds: int = 4) -> Iterator[Trial]:
    """Yield a focal length 0.5 mm too long, stations observed."""
    for photos in STRIPS:
        for seed in range(1, seeds + 1):
            block = strip(photos, seed, observed=True)
            yield Trial(
                name=f"focal length, {photos} photos, seed {seed}",
                block=altered(block, cameras={"focal_length": block.cameras.focal_length + 0.5}),
                kinds=(_K.FOCAL_LENGTH,),
                size=0.5,
                may_go=_nothing(block),
            )


def tides(seeds: int = 3) -> Iterator[Trial]:
    """Yield wrong tides, of one photo, of half of a strip and of all, where half of the points are submerged."""
    for seed in range(1, seeds + 1):
        block = altered(strip(10, seed, wet=0.8), photos={"tide_group": np.repeat(["A", "B"], 5)})
        for photos, kind in ((slice(4, 5), _K.TIDE), (slice(0, 5), _K.TIDES), (slice(0, 10), _K.TIDES)):
            ids = tuple(block.photos.ids[photos].tolist())
            for size in (3.0, -6.0):
                yield Trial(
                    name=f"tides of {len(ids)} photos {size:g} m, seed {seed}",
                    block=altered(block, photos={"tide": added(photos, size)}),
                    kinds=(kind,),
                    photos=ids,
                )


def clean(seeds: int = 4) -> Iterator[Trial]:
    """Yield strips with nothing wrong."""
    for seed in range(1, seeds + 1):
        for photos in STRIPS:
            for observed in (False, True):
                for program in ("IIA", "IIIA"):
                    block = strip(photos, 100 + seed, observed=observed, program=program)
                    yield Trial(
                        name=f"clean, {photos} photos, observed {observed}, {program}, seed {seed}", block=block
                    )


PARTS: dict[str, Callable[[], Iterator[Trial]]] = {
    "control": control,
    "exchanged": exchanged,
    "focal": focal_length,
    "tides": tides,
    "clean": clean,
}


def main(names: list[str]) -> None:
    """Print how many of each part are right, and what is wrong with the others."""
    for name in names or PARTS:
        start = time.perf_counter()
        faults = [(trial.name, fault(trial)) for trial in PARTS[name]()]
        print(*(f"  {trial}: {wrong}\n" for trial, wrong in faults if wrong), sep="", end="")
        right = sum(not wrong for _, wrong in faults)
        print(f"{name}: {right} of {len(faults)}, {time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
