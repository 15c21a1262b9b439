"""What the search names on simulated strips with one cause of misfit each: a measured study.

    python tests/blunders/study.py            # everything, a table of counts
    python tests/blunders/study.py control    # one part

The parts are functions that yield `Trial`s; the slow tests run a few of each.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from altered import added, altered
from musatpy.errors import AdjustmentError
from musatpy.model import Block, Cause, CauseKind, Editing, Finding
from musatpy.pipeline import adjust, causes_of
from musatpy.simulation import simulate, spec_from_table

SIZES = (1.0, 2.0, 5.0, 10.0, 30.0, 100.0)  # m, of wrong control
STRIPS = (6, 10, 20)  # photos
_K = CauseKind


@lru_cache(maxsize=64)
def strip(photos: int, seed: int = 1, *, observed: bool = False, wet: float = 0.3, program: str = "IIIA") -> Block:
    """Return a strip at 750 m, control of 5 cm; `observed` stations have sigmas of 10 cm."""
    stations = {"position_error": 0.1, "position_sigma": 0.1} if observed else {"position_error": 15.0}
    table = {
        "seed": seed,
        "job": {"system": "LOCL"},
        "flight": {"photos": photos, "height": 750.0, "attitude_scatter": 1.0, "station_scatter": 10.0},
        "terrain": {"relief": 30.0},
        "water": {"tide_scatter": 0.2},
        "shoal": [{"share": wet, "depth": [1.0, 10.0]}],
        "points": {"per_site": 2, "extra": [{"number": 4 * photos}]},
        "control": [{"kind": "full", "number": max(6, photos), "sigma": 0.05, "error": 0.05}],
        "stations": {**stations, "attitude_error": 0.5},
        "options": {"program": program, "refraction": "RIGOROUS"},
    }
    return simulate(spec_from_table(table)).block


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One deck with what is wrong in it."""

    name: str
    block: Block
    right: Callable[[Answer], str]  # what is wrong with the answer, empty if nothing is


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
        solution = adjust(altered(block, options={"editing": Editing.EDIT}))
    except AdjustmentError:
        return Answer(causes=causes_of(block), findings=(), edited=block, unedited="it cannot be adjusted")
    return Answer(
        causes=solution.causes, findings=solution.findings, edited=solution.edited, unedited=solution.unedited
    )


def first(causes: tuple[Cause, ...]) -> list[Cause]:
    """Return the causes of the first rank in the first group."""
    return [one for one in causes if one.group == 1 and one.rank == 1]


def control(strips: tuple[int, ...] = STRIPS, sizes: tuple[float, ...] = SIZES) -> Iterator[Trial]:
    """Yield wrong control, up and horizontal, of a point of two and of three rays."""
    for photos in strips:
        block = strip(photos)
        seen = np.bincount(block.plates.point, minlength=len(block.points.ids))[block.control.point]
        for rays in (2, 3):
            row = int(np.flatnonzero(seen == rays)[len(np.flatnonzero(seen == rays)) // 2])
            for size in sizes:
                for axis, kind in ((0, _K.HORIZONTAL), (2, _K.VERTICAL)):
                    wrong = altered(block, control={"position": added((row, axis), size)})
                    yield Trial(
                        name=f"{photos} photos, {rays} rays, {size:g} m {kind}",
                        block=wrong,
                        right=_names_control(str(block.points.ids[block.control.point[row]]), kind, row, axis),
                    )


def _names_control(point: str, kind: CauseKind, row: int, axis: int) -> Callable[[Answer], str]:
    def right(answer: Answer) -> str:
        named = {(one.kind, one.points) for one in first(answer.causes)}
        if not any(points == (point,) and one in (kind, _K.CONTROL) for one, points in named):
            return f"named {sorted(str(one) for one in named)}"
        known = answer.edited.control.known
        innocent = np.ones(3, dtype=bool)
        innocent[:2] = innocent[:2] & (axis == 2)
        innocent[2] = axis != 2
        if not known[row][innocent].all() or not np.delete(known, row, axis=0).all():
            return "innocent control out"
        return "" if answer.edited.plates.triangulated.all() else "innocent images out"

    return right


def exchanged(seeds: int = 3) -> Iterator[Trial]:
    """Yield photos whose plate cards, or whose station cards, bear each other's labels."""
    for seed in range(1, seeds + 1):
        for observed in (False, True):
            block = strip(10, seed, observed=observed)
            for pair in ((4, 5), (2, 7)):
                ids = tuple(block.photos.ids[list(pair)].tolist())
                for which in ("plates", "stations"):
                    wrong = (
                        _with_exchanged_plates(block, pair)
                        if which == "plates"
                        else _with_exchanged_stations(block, pair)
                    )
                    name = f"{which} of {ids}, stations {'observed' if observed else 'approximate'}, seed {seed}"
                    yield Trial(name=name, block=wrong, right=_names(_K.LABELS, photos=ids))


def _with_exchanged_plates(block: Block, pair: tuple[int, int]) -> Block:
    photo = block.plates.photo
    other = np.select([photo == pair[0], photo == pair[1]], [pair[1], pair[0]], photo)
    return altered(block, plates={"photo": other})


def _with_exchanged_stations(block: Block, pair: tuple[int, int]) -> Block:
    position = block.photos.position.copy()
    position[list(pair)] = position[list(pair[::-1])]
    return altered(block, photos={"position": position})


def _names(kind: CauseKind, photos: tuple[str, ...] | None = None) -> Callable[[Answer], str]:
    def right(answer: Answer) -> str:
        causes = [one for one in first(answer.causes) if one.kind is kind]
        if not causes or (photos is not None and set(causes[0].photos) != set(photos)):
            return f"named {[(str(one.kind), one.photos) for one in first(answer.causes)]}"
        return _innocent(answer)

    return right


def _innocent(answer: Answer) -> str:
    """Return what went out though nothing should."""
    return "" if answer.edited.plates.triangulated.all() and answer.edited.control.known.all() else "innocent out"


def focal_length(seeds: int = 4) -> Iterator[Trial]:
    """Yield a focal length 0.5 mm too long, stations observed."""
    for photos in STRIPS:
        for seed in range(1, seeds + 1):
            block = strip(photos, seed, observed=True)
            cameras = block.cameras
            wrong = replace(block, cameras=replace(cameras, focal_length=cameras.focal_length + 0.5))

            def right(answer: Answer) -> str:
                causes = [one for one in first(answer.causes) if one.kind is _K.FOCAL_LENGTH]
                if not causes:
                    return f"named {[str(one.kind) for one in first(answer.causes)]}"
                off = abs(causes[0].size[0] - 0.5)
                if off > max(0.05, 2.0 * causes[0].sigma[0]):
                    return f"size {causes[0].size[0]:.3f} mm, sigma {causes[0].sigma[0]:.3f}"
                return _innocent(answer) or ("" if answer.unedited else "edited")

            yield Trial(name=f"focal length, {photos} photos, seed {seed}", block=wrong, right=right)


def tides(seeds: int = 3) -> Iterator[Trial]:
    """Yield wrong tides, of one photo, of half of a strip and of all, where half of the points are submerged."""
    for seed in range(1, seeds + 1):
        block = strip(10, seed, wet=0.8)
        group = np.where(np.arange(10) < 5, "A", "B")
        block = altered(block, photos={"tide_group": group})
        for photos, kind in (((4,), _K.TIDE), (tuple(range(5)), _K.TIDES), (tuple(range(10)), _K.TIDES)):
            for size in (3.0, -6.0):
                ids = tuple(block.photos.ids[list(photos)].tolist())
                yield Trial(
                    name=f"tides of {len(photos)} photos {size:g} m, seed {seed}",
                    block=altered(block, photos={"tide": added(list(photos), size)}),
                    right=_names_tide(kind, ids),
                )


def _names_tide(kind: CauseKind, photos: tuple[str, ...]) -> Callable[[Answer], str]:
    def right(answer: Answer) -> str:
        if any(one.kind is kind and set(one.photos) == set(photos) for one in first(answer.causes)):
            return ""
        return f"named {[(str(one.kind), one.photos, one.points) for one in first(answer.causes)]}"

    return right


def clean(seeds: int = 4) -> Iterator[Trial]:
    """Yield strips with nothing wrong."""
    for seed in range(1, seeds + 1):
        for photos in STRIPS:
            for observed in (False, True):
                for program in ("IIA", "IIIA"):
                    block = strip(photos, 100 + seed, observed=observed, program=program)
                    name = f"clean, {photos} photos, observed {observed}, {program}, seed {seed}"
                    yield Trial(
                        name=name,
                        block=block,
                        right=lambda s: "" if not s.findings and not s.causes else f"{len(s.findings)} findings",
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
        right = count = 0
        start = time.perf_counter()
        for trial in PARTS[name]():
            fault = trial.right(edited(trial.block))
            count, right = count + 1, right + (not fault)
            if fault:
                print(f"  {trial.name}: {fault}", flush=True)
        print(f"{name}: {right} of {count}, {time.perf_counter() - start:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
