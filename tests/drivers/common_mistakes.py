"""Mistakes that are common to a whole deck, put into three simulated blocks: what becomes of each run.

`python -m drivers.common_mistakes [--seeds N] [--block NAME] [MISTAKE ...]` prints for every mistake the verdict,
the first cause, the first reason of page 1, and how far the worst station or point stands from the truth in its
sigmas.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from altered import altered, put
from musatpy import adjust
from musatpy.errors import ProblemsError
from musatpy.formats.musat import check_deck, deck_bytes
from musatpy.model import Block, Cause, CauseKind, Grade
from musatpy.reports import answer
from musatpy.simulation import Simulation, simulate
from musatpy.simulation.simulation_spec import load_spec, spec_from_table
from musatpy.statistics import Statistics, metric_differences

FIXTURES = Path(__file__).parents[2] / "fixtures"
FAR = 4.0  # sigmas
REFUSED = "refused"  # by the check of the deck, or because it cannot be adjusted
FEET = 3.2808
_POSSIBLE = "possible cause: "
_K = CauseKind
_STRIP = {
    "job": {"system": "LOCL"},
    "flight": {"photos": 10, "height": 1500.0, "attitude_scatter": 1.0, "station_scatter": 10.0},
    "terrain": {"level": 40.0, "relief": 30.0},
    "water": {"level": 1.5, "tide_scatter": 0.2},
    "shoal": [{"share": 0.5, "depth": [1.0, 10.0]}],
    "points": {"per_site": 2, "extra": [{"number": 40}]},
    "control": [{"kind": "full", "number": 8, "sigma": 0.1, "error": 0.1}],
    "measurement": {"noise": 5.0, "sigma": 5.0},
}
_OBSERVED = {
    "position_error": 0.1,
    "position_sigma": 0.1,
    "attitude_error": 0.005,
    "attitude_sigma": 18.0,
}


def simulated(name: str, seed: int) -> Simulation:
    """Return one of the `BLOCKS`: three photos, ten of WATPT with computed starts, ten of IIIA."""
    if name == "three":
        return simulate(load_spec(FIXTURES / "st_thomas/st_thomas.toml"), seed)
    watpt = name == "watpt"
    stations = {"position_error": 15.0, "attitude_error": 0.5} if watpt else _OBSERVED
    options = {"initial": "COMPUTE"} if watpt else {"program": "IIIA", "refraction": "RIGOROUS"}
    return simulate(spec_from_table(_STRIP | {"stations": stations, "options": options}), seed)


BLOCKS = ("three", "watpt", "iiia")
_simulated = lru_cache(maxsize=16)(simulated)


@dataclass(frozen=True, kw_only=True)
class Mistake:
    """A mistake that is common to a deck."""

    name: str
    spoil: Callable[[Block], Block]
    right: tuple[CauseKind, ...]  # causes of the right class
    word: str = "nothing else"  # by which page 1 names what has no test


def _scaled(axes: Sequence[int] | slice, factor: float) -> Callable[[Block], Block]:
    """Return what multiplies coordinates of the control."""

    def spoil(block: Block) -> Block:
        position = block.control.position.copy()
        position[:, axes] *= factor
        return altered(block, control={"position": position})

    return spoil


def _unit(factor: float) -> Callable[[Block], Block]:
    """Return what multiplies all lengths of the control: those of a geographic one are its heights."""
    return lambda block: _scaled(_lengths(block), factor)(block)


def _lengths(block: Block) -> slice:
    return slice(0, 3) if block.options.system == "LOCL" else slice(2, 3)


def _plates(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Block], Block]:
    return lambda block: altered(block, plates={"xy": change})


def _flags(share: float) -> Callable[[Block], Block]:
    """Return what takes the flags of a share of the submerged points, of the first one at least."""

    def spoil(block: Block) -> Block:
        submerged = np.flatnonzero(block.points.bathymetric)
        some = submerged[:: round(1.0 / share)] if share else submerged[:1]
        return altered(block, points={"bathymetric": put(some, False)})

    return spoil


def _index(value: float) -> Callable[[Block], Block]:
    return lambda block: altered(block, water={"index": value})


def _focal(factor: float) -> Callable[[Block], Block]:
    return lambda block: altered(block, cameras={"focal_length": lambda f: f * factor})


def _heights(shift: float) -> Callable[[Block], Block]:
    return lambda block: altered(block, control={"position": lambda xyz: xyz + np.array([0.0, 0.0, shift])})


def _exchanged_photos(block: Block) -> Block:
    """Return the block with the plate cards of the first photo and the last one under each other's name."""
    last = len(block.photos.ids) - 1
    return altered(block, plates={"photo": lambda of: np.where(of == 0, last, np.where(of == last, 0, of))})


MISTAKES = (
    Mistake(name="nothing", spoil=lambda block: block, right=()),
    Mistake(name="flag forgotten", spoil=_flags(0.0), right=(_K.FLAG,), word="flag"),
    Mistake(name="flags, half", spoil=_flags(0.5), right=(_K.FLAG,), word="flag"),
    Mistake(name="flags, all", spoil=_flags(1.0), right=(_K.FLAG,), word="flag"),
    Mistake(name="index 1.43", spoil=_index(1.43), right=(_K.INDEX,), word="index"),
    Mistake(name="index 1.0", spoil=_index(1.0), right=(_K.INDEX,), word="index"),
    Mistake(name="focal 2 %", spoil=_focal(1.02), right=(_K.FOCAL_LENGTH,), word="focal length"),
    Mistake(name="focal a tenth", spoil=_focal(0.1), right=(_K.UNIT, _K.FOCAL_LENGTH), word="focal length"),
    Mistake(
        name="tide sign",
        spoil=lambda block: altered(block, photos={"tide": lambda tide: -tide}),
        right=(_K.TIDES,),
        word="tide",
    ),
    Mistake(name="control +1 m", spoil=_heights(1.0), right=(_K.TIDES, _K.VERTICAL), word="height"),
    Mistake(name="plates in cm", spoil=_plates(lambda xy: xy / 10.0), right=(_K.UNIT,)),
    Mistake(name="x mirrored", spoil=_plates(lambda xy: xy * [-1.0, 1.0]), right=(_K.AXES,)),
    Mistake(name="y mirrored", spoil=_plates(lambda xy: xy * [1.0, -1.0]), right=(_K.AXES,)),
    Mistake(name="x/y exchanged", spoil=_plates(lambda xy: xy[:, ::-1]), right=(_K.AXES,)),
    Mistake(
        name="E/N exchanged",
        spoil=lambda block: altered(block, control={"position": lambda xyz: xyz[:, [1, 0, 2]]}),
        right=(_K.AXES,),
    ),
    Mistake(name="control in feet", spoil=_unit(FEET), right=(_K.UNIT,), word="scale of control"),
    Mistake(name="control in km", spoil=_unit(1e-3), right=(_K.UNIT,)),
    Mistake(name="heights in feet", spoil=_scaled([2], FEET), right=(_K.UNIT,)),
    Mistake(name="photos exchanged", spoil=_exchanged_photos, right=(_K.LABELS,)),
)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a block with a mistake."""

    block: str
    mistake: Mistake
    grade: str  # or REFUSED
    causes: tuple[Cause, ...] = ()
    page: str = ""  # page 1, or the messages of a refused deck
    first: str = ""  # reason of page 1, or message
    moved: float = np.nan  # sigmas of the worst station or point, from the truth

    @property
    def named(self) -> bool:
        """True where a cause of the first group, or the first one of a refused deck, is of the right class."""
        if self.grade == REFUSED:
            possible = [line for line in self.page.splitlines() if line.startswith(_POSSIBLE)]
            return any(possible[0].startswith(f"{_POSSIBLE}{kind}") for kind in self.mistake.right if possible)
        return any(cause.kind in self.mistake.right for cause in self.causes if cause.group == 1)

    @property
    def told(self) -> bool:
        """True where page 1 names the very parameter as one whose errors no test finds, or large ones alone."""
        named, of_common = "", False
        for line in self.page.splitlines():
            of_common = line.startswith("Common errors") or (of_common and line.startswith(" "))
            named += f"{line}\n" if of_common else ""
        return self.mistake.word in named

    @property
    def quiet(self) -> bool:
        """True where an answer is accepted that is far from the truth, and page 1 does not say that it may be."""
        return self.grade == Grade.ACCEPTED and self.moved > FAR and not self.told


def outcome(name: str, seed: int, mistake: Mistake) -> Outcome:
    """Return what becomes of a block of `BLOCKS` with a mistake."""
    true = _simulated(name, seed)
    block = None
    try:
        block, problems = check_deck(deck_bytes(mistake.spoil(true.block)))
        if block is None:
            raise ProblemsError(problems)
        statistics = Statistics(adjust(block))
    except ProblemsError as error:
        texts = [problem.message for problem in error.problems]
        return Outcome(block=name, mistake=mistake, grade=REFUSED, page="\n".join(texts), first=texts[0])
    verdict = statistics.verdict
    lines = [line for section in answer.sections(statistics, lambda title: 0) for line in section.lines]
    first = [reason.text for reason in verdict.reasons] or [line for line in lines[1:] if "no test" in line]
    return Outcome(
        block=name,
        mistake=mistake,
        grade=verdict.grade,
        causes=statistics.solution.causes,
        page="\n".join(lines),
        first=next(iter(first), ""),
        moved=worst_movement(true, statistics),
    )


def worst_movement(true: Simulation, statistics: Statistics) -> float:
    """Return by how many of its sigmas the worst station or point is off the truth, in any coordinate."""
    solution, block, truth = statistics.solution, statistics.block, true.truth
    number = {name: row for row, name in enumerate(true.block.points.ids.tolist())}
    rows = [number[name] for name in block.points.ids.tolist()]
    off = [
        metric_differences(block, truth.points.job[rows], solution.points.position) / statistics.point_sigmas,
        metric_differences(block, truth.stations.job, solution.stations.position)
        / statistics.station_sigmas[:, :3],
    ]
    return float(np.nanmax(np.abs(np.concatenate(off)), initial=0.0))


def outcomes(names: Sequence[str], seeds: Sequence[int], mistakes: Sequence[Mistake]) -> Iterator[Outcome]:
    """Yield what becomes of every block with every mistake."""
    for name in names:
        for seed in seeds:
            for mistake in mistakes:
                with np.errstate(all="ignore"):
                    yield outcome(name, seed, mistake)


def main() -> None:
    """Print a line for every block and mistake, and the counts."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--block", choices=BLOCKS, action="append")
    parser.add_argument("mistakes", nargs="*")
    asked = parser.parse_args()
    mistakes = [m for m in MISTAKES if not asked.mistakes or any(word in m.name for word in asked.mistakes)]
    runs = []
    for run in outcomes(asked.block or BLOCKS, range(1, asked.seeds + 1), mistakes):
        runs.append(run)
        texts = [line for line in run.page.splitlines() if line.startswith(_POSSIBLE)]
        cause = next((str(one).partition(":")[0] for one in run.causes), next(iter(texts), "-"))
        marks = ("named" if run.named else "") + (" QUIET" if run.quiet else "")
        head = f"{run.block:6}{run.mistake.name:17}{run.grade:9}{run.moved:9.1f}  {marks:6}"
        print(f"{head} {cause[:70]:70} | {run.first[:90]}", flush=True)
    spoilt = [run for run in runs if run.grade != Grade.ACCEPTED]
    print(f"{len(runs)} runs: quiet {sum(run.quiet for run in runs)}; ", end="")
    print(f"not accepted {len(spoilt)}, the right class first in {sum(run.named for run in spoilt)}")


if __name__ == "__main__":
    main()
