"""What waves do to a map, as text and as a table of every point."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from musatpy.reports.fields import Field, unrecorded
from musatpy.reports.pages import text_of
from musatpy.reports.table import Table
from musatpy.sea.study import WIDE, Trials, WaveStudy, flying_height
from musatpy.units import DEGREE

_COORDINATES = ("X", "Y", "Z")
_BAR = 50  # characters of the longest bar of a histogram

WAVES: Table[WaveStudy] = Table(
    (
        unrecorded("Wave", "I4", lambda s: range(1, len(s.spec.wave) + 1)),
        unrecorded("Shape", "A10", lambda s: [wave.shape for wave in s.spec.wave]),
        unrecorded("Period\ns", "F6.1", lambda s: s.theory.period),
        unrecorded("Length\nm", "F7.1", lambda s: s.length),
        unrecorded("Speed\nm/s", "F6.2", lambda s: s.speed),
        unrecorded("Group\nm/s", "F6.2", lambda s: s.theory.group_speed),
        unrecorded("Height\nm", "F6.2", lambda s: s.theory.height),
        unrecorded("Breaks at\nm", "F9.2", lambda s: s.theory.breaking_height),
        unrecorded("Towards\ndeg", "F7.1", lambda s: [wave.azimuth for wave in s.spec.wave]),
        unrecorded("Crest\nm", "F7.1", lambda s: [wave.crest for wave in s.spec.wave]),
    )
)
ERRORS: Table[WaveStudy] = Table(
    (
        unrecorded("Coordinate", "A10", lambda s: _COORDINATES),
        unrecorded("Maximum\nm", "F8.3", lambda s: s.spread.largest),
        unrecorded("at No.", "I6", lambda s: s.spread.point + 1),
        unrecorded("Mean\nm", "F8.3", lambda s: s.spread.mean),
        unrecorded("Sigma\nm", "F8.3", lambda s: s.spread.sigma),
        unrecorded("Allowed\nm", "F8.3", lambda s: s.verdict.allowed),
        unrecorded("Verdict", "A8", lambda s: _words(s.verdict.kept)),
    )
)
POINTS = ("no", "x", "y", "z", "dx", "dy", "dz", "y_parallax", "refraction_points_left", "refraction_points_right")


def waves_text(study: WaveStudy) -> str:
    """Return the report of a wave experiment."""
    spec = study.spec
    left, right = (", ".join(f"{value:.1f}" for value in camera) for camera in spec.stereo.cameras)
    height = flying_height(spec)
    lines = [
        spec.title,
        "",
        f"Cameras at ({left}) and ({right}) m, {spec.stereo.interval:g} s apart, {height:.1f} m above the bottom",
        f"Water {spec.water.depth:g} m deep, index {spec.water.index:g}; {len(study.errors.points)} check points",
        "",
        *WAVES.text(study),
        *_notes(study),
        "",
        "Errors of taking the water for level, mapped minus true",
        "",
        *ERRORS.text(study),
        "",
        f"Allowed are 1/{spec.accuracy.plan:g} of the flying height in plan, 1/{spec.accuracy.height:g} in height",
        *_rays(study),
        *_histograms(study),
    ]
    for trials in study.studies:
        lines += ["", *_trials(trials)]
    return text_of(lines)


def points_csv(study: WaveStudy) -> str:
    """Return true places and errors (m) of every check point, comma separated: a map of the errors in numbers."""
    errors = study.errors
    numbers = np.column_stack([errors.points, errors.error, errors.parallax])
    rows = [
        ",".join([str(no), *(f"{value:.4f}" for value in row + 0.0), *map(str, count)])
        for no, (row, count) in enumerate(zip(numbers, errors.number, strict=True), start=1)
    ]
    return "\n".join([",".join(POINTS), *rows]) + "\n"


def _notes(study: WaveStudy) -> list[str]:
    theory = study.theory
    return [
        f"note: wave {i + 1} is higher than a wave of its length can stand there"
        for i in np.flatnonzero(theory.breaks)
    ]


def _rays(study: WaveStudy) -> list[str]:
    number, parallax = study.errors.number, study.errors.parallax
    several = int((number > 1).sum())
    lines = [
        f"Y-parallax of the mapped points: {np.sqrt(np.mean(parallax**2)):.3f} m RMS, "
        f"{np.abs(parallax).max():.3f} m at most",
        f"Rays with several refraction points: {several} of {number.size}",
    ]
    if several:
        lines.append(f"    at most {number.max()} points; the one of the least optical path counts")
    if study.wide:
        lines.append(
            f"note: {study.wide} rays are more than {WIDE / DEGREE:.0f} degrees from the vertical: "
            "points that are not in the overlap of two photographs"
        )
    missing = int((~study.errors.complete).sum())
    if missing:
        lines.append(f"note: of {missing} rays the search may have missed refraction points")
    return lines


def _histograms(study: WaveStudy) -> list[str]:
    lines = []
    for name, edges, count in zip(_COORDINATES, study.histogram.edges, study.histogram.count, strict=True):
        lines += ["", f"Histogram of the errors in {name}: m, points", ""]
        middle = (edges[:-1] + edges[1:]) / 2.0
        for at, points in zip(middle, count, strict=True):
            bar = "*" * int(np.ceil(_BAR * points / count.max()))
            lines.append(f"{_signed_zero_free(at):8.3f}  {points:5d}  {bar}".rstrip())
    return lines


def _trials(trials: Trials) -> list[str]:
    table: Table[Trials] = Table(
        (
            unrecorded(
                f"{trials.name}\n{trials.unit}",
                "F8.2",
                lambda t: [trial.value for trial in t.trials if trial.spread],
            ),
            *(_maximum(axis) for axis in range(3)),
            *(_sigma(axis) for axis in range(3)),
            unrecorded(
                "Verdict", "A8", lambda t: _words(trial.verdict.kept.all() for trial in t.trials if trial.verdict)
            ),
        )
    )
    failed = [
        f"note: {trials.name.lower()} {t.value:g} {trials.unit}: {t.reason}" for t in trials.trials if t.reason
    ]
    return [f"{trials.name} varied", "", *table.text(trials), *failed]


def _maximum(axis: int) -> Field[Trials]:
    return unrecorded(
        f"Max {_COORDINATES[axis]}\nm", "F8.3", lambda t: [s.spread.largest[axis] for s in t.trials if s.spread]
    )


def _sigma(axis: int) -> Field[Trials]:
    return unrecorded(
        f"Sigma {_COORDINATES[axis]}\nm", "F8.3", lambda t: [s.spread.sigma[axis] for s in t.trials if s.spread]
    )


def _words(kept: Iterable[object]) -> list[str]:
    return ["kept" if is_kept else "exceeded" for is_kept in kept]


def _signed_zero_free(value: float) -> float:
    return 0.0 if abs(value) < 0.0005 else value
