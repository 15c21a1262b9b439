"""The ranked causes of what does not fit, in words: what may be wrong, its size, and which card to read again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from musatpy.adjustment.unknowns import State, given_minus
from musatpy.adjustment.wavy_water import Sea
from musatpy.arrays import FloatArray
from musatpy.blunders.competition import Rival, rivals
from musatpy.blunders.finding_list import flag_findings
from musatpy.blunders.hypotheses import Hypothesis
from musatpy.blunders.names import FAR, exchanged_photos, flying_height
from musatpy.blunders.revisions import CARDS, CONTROL, PLATES, STATIONS, in_words
from musatpy.blunders.scene import Scene
from musatpy.blunders.search import Search
from musatpy.model import Block, Cause, CauseKind, CoordinateSystem, Initial
from musatpy.model.findings import mnemonics
from musatpy.statistics.verdict import in_feet
from musatpy.units import DEGREE, FOOT

MOST = 12  # causes that are named
_TURNED = 10.0 * DEGREE  # farther than any start value that serves


def causes(search: Search, sea: Sea | None) -> tuple[Cause, ...]:
    """Return the causes, `MOST` at most: the group that explains most first, its equal explanations together."""
    ranked: dict[int, list[Cause]] = {}
    for rival in rivals(search, sea, MOST):
        cause = cause_of(search.block, search.last.judgement.sigma0, rival)
        ranked.setdefault(rival.group, []).append(cause)
    groups = [
        *ranked.values(),
        *([cause] for cause in _named(search)),
        *_misplaced(search.block, search.last.scene, search.last.state),
    ]
    groups.sort(key=lambda group: -max(np.inf if np.isnan(cause.drop) else cause.drop for cause in group))
    said: dict[str, Cause] = {}  # the whole and its parts may say the same
    for number, group in enumerate(groups, 1):
        for cause in group:
            said.setdefault(str(cause), replace(cause, group=number))
    return tuple(said.values())[:MOST]


def cause_of(block: Block, sigma0: float, rival: Rival) -> Cause:
    """Return a hypothesis in words."""
    hypothesis = rival.hypothesis
    kind, words = hypothesis.kind, in_words(hypothesis)
    size, sigma = hypothesis.error / kind.scale, hypothesis.sigma * sigma0 / kind.scale
    if kind is CauseKind.UNIT:
        size, sigma = np.array([hypothesis.value]), np.full(1, np.nan)
    shown = (len(kind.axes) or len(size)) if kind.sized else 0
    name = f"; {hypothesis.name}" if kind is CauseKind.AXES and hypothesis.name else ""
    return Cause(
        kind=kind,
        cards=mnemonics(words.cards, block.options.system),
        photos=tuple(block.photos.ids[list(hypothesis.photo)].tolist()),
        points=tuple(block.points.ids[list(hypothesis.point)].tolist()),
        component=(kind is CauseKind.TIDES and hypothesis.name) or words.component,
        size=tuple(size[:shown].tolist()),
        sigma=tuple(sigma[:shown].tolist()),
        unit=kind.unit,
        parameters=hypothesis.parameters,
        drop=rival.drop,
        test=float(np.sqrt(max(rival.drop, 0.0) / max(hypothesis.parameters, 1)) / sigma0),
        rank=rival.rank,
        advice=f"{words.advice}{name}",
    )


def _named(search: Search) -> Iterator[Cause]:
    """Yield images with wrong names, and wrong flags."""
    block, variance = search.block, search.last.judgement.sigma0**2
    photos, points = block.photos.ids, block.points.ids
    for renaming in search.renamings:
        old, new = str(points[block.plates.point[renaming.row]]), str(points[renaming.point])
        yield Cause(
            kind=CauseKind.NAME,
            cards=mnemonics(CauseKind.NAME.cards, block.options.system),
            photos=(str(photos[block.plates.photo[renaming.row]]),),
            points=(old, new),
            parameters=2,
            drop=renaming.test**2 * variance,
            test=renaming.test,
            advice=f"it is point {new}: {CauseKind.NAME.advice}",
        )
    changed = {str(points[point]) for point in search.flags}
    for finding in flag_findings(search):
        yield Cause(
            kind=CauseKind.FLAG,
            cards=mnemonics(CauseKind.FLAG.cards, block.options.system),
            points=(finding.point,),
            component=finding.blunder,
            size=finding.size,
            unit=CauseKind.FLAG.unit,
            parameters=1,
            drop=finding.test**2 * variance if finding.point in changed else 0.0,
            test=finding.test,
            advice=CauseKind.FLAG.advice,
        )


def _misplaced(block: Block, scene: Scene, state: State) -> Iterator[list[Cause]]:
    """Yield what may be wrong with given stations, not observed, that are far from where the images say.

    In groups of equal explanations: a unit of length, labels, or wrong cards.
    """
    photos = block.photos
    given = np.isfinite(np.concatenate([photos.position, photos.attitude], axis=1)).all(axis=1)
    if not given.any():
        return
    difference = given_minus(photos, scene.network.frame, state.position, state.M, given)
    shift, turn = difference[:, :3], difference[:, 3:]
    far = np.linalg.norm(np.nan_to_num(shift), axis=1) / (FAR * flying_height(scene, state))
    far = np.where(np.isfinite(photos.position_sigma).any(axis=1), 0.0, far)
    turned = np.abs(np.nan_to_num(turn)).max(axis=1) / _TURNED
    worst = np.maximum(far, np.where(np.isfinite(photos.attitude_sigma).any(axis=1), 0.0, turned))
    if not (worst > 1.0).any():
        return
    whose, _ = in_feet(scene.network.frame.working(photos.position[given]), state.position[given])
    if whose and block.options.system is CoordinateSystem.LOCAL:
        member = {"control": CONTROL, "stations": STATIONS}[whose]
        yield [
            _in_words(block, Hypothesis(kind=CauseKind.UNIT, member=member, value=1.0 / FOOT), size=(1.0 / FOOT,))
        ]
        return
    exchanged: set[int] = set()
    for pair in exchanged_photos(block, scene, state):
        if far[list(pair)].max() > 0.0:
            exchanged |= set(pair)
            labels = [Hypothesis(kind=CauseKind.LABELS, photo=pair, member=which) for which in (CARDS, PLATES)]
            yield [_in_words(block, revision) for revision in labels]
    for photo in np.argsort(-worst, kind="stable").tolist():
        if worst[photo] > 1.0 and photo not in exchanged and block.options.initial is not Initial.COMPUTE:
            yield [_start(block, photo, shift[photo], turn[photo], far[photo] > 1.0)]


def _in_words(block: Block, revision: Hypothesis, size: tuple[float, ...] = ()) -> Cause:
    words = in_words(revision)
    return Cause(
        kind=revision.kind,
        cards=mnemonics(words.cards, block.options.system),
        photos=tuple(block.photos.ids[list(revision.photo)].tolist()),
        component=words.component,
        size=size,
        advice=words.advice,
    )


def _start(block: Block, photo: int, shift: FloatArray, turn: FloatArray, far: bool) -> Cause:
    kind = CauseKind.POSITION if far else CauseKind.ATTITUDE
    return Cause(
        kind=CauseKind.START,
        cards=mnemonics(kind.cards, block.options.system),
        photos=(str(block.photos.ids[photo]),),
        component=kind.component,
        size=tuple((shift if far else turn / DEGREE).tolist()),
        unit="m" if far else "degrees",
        parameters=3,
        drop=0.0,
        advice=CauseKind.START.advice,
    )
