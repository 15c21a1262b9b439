"""The ranked causes of what does not fit, in words: what may be wrong, its size, and which card to read again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from musatpy.adjustment.kinds import MEASURED
from musatpy.adjustment.wavy_water import Sea
from musatpy.blunders import revisions
from musatpy.blunders.competition import Rival, rivals
from musatpy.blunders.explanation import UNIT
from musatpy.blunders.far_stations import misplaced
from musatpy.blunders.finding_list import flag_findings
from musatpy.blunders.hypotheses import Hypothesis
from musatpy.blunders.revisions import CARDS
from musatpy.blunders.search import Search
from musatpy.model import Block, Cause, CauseKind, CoordinateSystem
from musatpy.units import ARC_SECOND, MICROMETRE

MOST = 12  # causes that are named
_C = CauseKind
_CARDS = {
    _C.TIDE: ("TID",),
    _C.TIDES: ("TID",),
    _C.FOCAL_LENGTH: ("CAM",),
    _C.PRINCIPAL_POINT: ("CAM",),
    _C.INDEX: ("WTR",),
    _C.ELEVATION: ("EQL",),
    **{_C(kind.noun): (kind.card,) for kind in MEASURED},
    _C.ATTITUDE: ("ATT",),
    _C.FLAG: ("PLT",),
    _C.NAME: ("PLT",),
    _C.EXCHANGED_IMAGES: ("PLT",),
    _C.IMAGE: ("PLT",),
    _C.IMAGES: ("PLT",),
}
ADVICE = {
    _C.VERTICAL: "read the height on the control card again: digits, sign, unit, sigma",
    _C.HORIZONTAL: "read the position on the control card again: digits, sign, sigma, the name of the point",
    _C.CONTROL: "read the control card again: digits, unit, sigma, the name of the point",
    _C.EXCHANGED_CONTROL: "each point lies where the other card says: exchange the names on the two control cards",
    _C.TIDE: "read the tide card again: sign, datum, time of the exposure",
    _C.TIDES: "read the tides again: datum, sign, time zone; no single image can be blamed",
    _C.FOCAL_LENGTH: "compare the camera card with the calibration; a common error of the heights of observed "
    "stations looks alike",
    _C.PRINCIPAL_POINT: "compare the camera card with the calibration, signs and plate axes too",
    _C.INDEX: "read the water card again",
    _C.ELEVATION: "is the point on the shore line? read the names on the card again",
    **{_C(kind.noun): kind.advice for kind in MEASURED},
    _C.ATTITUDE: "read the attitude card again: digits, signs, sigmas",
    _C.POSITION: "read the station card again: digits, sigmas, the name of the photo",
    _C.STATION: "read station and attitude cards again: the name of the photo, digits, sigmas",
    _C.START: "read station and attitude cards again: the given values are far from what the images say",
    _C.FLAG: "look whether the point is submerged, and at the flag B of its plate cards",
    _C.NAME: "compare the name on the plate card with the plate",
    _C.EXCHANGED_IMAGES: "each fits the other photo: exchange the photo ids on the two plate cards",
    _C.IMAGE: "read the plate card again, then measure the image again: name, digits, sign",
    _C.IMAGES: "read the plate cards of the point again, then measure its images: is it one point on all of them?",
}


_AXES = {  # and the advice
    revisions.Y_REVERSED: ("y of the plates", "y runs down: reverse its sign, or read how the axes were defined"),
    revisions.X_REVERSED: (
        "x of the plates",
        "x runs backwards: reverse its sign, or read how the axes were defined",
    ),
    revisions.EXCHANGED: ("x and y of the plates", "exchanged: read the description of the comparator again"),
    revisions.CONTROL_EXCHANGED: (
        "plan of the control",
        "east and north are exchanged: read the list of control again",
    ),
    revisions.HEIGHTS_NEGATED: ("heights of the control", "they have the other sign: depths for heights?"),
}
_WHOSE = {  # whose unit is wrong, and to what
    revisions.CONTROL: ("control", "stations and tides"),
    revisions.STATIONS: ("stations", "control and tides"),
    revisions.PLATES_TO_FOCAL_LENGTH: ("plate coordinates", "the focal length"),
    revisions.HEIGHTS: ("heights of the control", "its plan"),
}
_UNITS_OF_GROUND = {1e-3: "kilometres", 1e2: "centimetres", 1e3: "millimetres"}
_UNITS_OF_PLATES = {1e-3: "metres", 0.1: "centimetres", 1e3: "micrometres"}
_COMPONENTS = {
    _C.VERTICAL: "height",
    _C.HORIZONTAL: "position",
    _C.FOCAL_LENGTH: "focal length",
    _C.POSITION: "position",
    _C.ATTITUDE: "angles",
}
_UNITS = {_C.FOCAL_LENGTH: "mm", _C.PRINCIPAL_POINT: "mm", _C.ATTITUDE: "arc sec", _C.IMAGE: "um"}
_NO_UNIT = (_C.INDEX, _C.UNIT)
_NO_SIZE = (_C.LABELS, _C.EXCHANGED_CONTROL, _C.EXCHANGED_IMAGES, _C.AXES, _C.NAME, _C.IMAGES)


def causes(search: Search, sea: Sea | None) -> tuple[Cause, ...]:
    """Return the causes, `MOST` at most: the group that explains most first, its equal explanations together."""
    ranked: dict[int, list[Cause]] = {}
    for rival in rivals(search, sea, MOST):
        cause = cause_of(search.block, search.last.judgement.sigma0, rival)
        ranked.setdefault(rival.group, []).append(cause)
    groups = [
        *ranked.values(),
        *([cause] for cause in _named(search)),
        *misplaced(search.block, search.last.scene, search.last.state),
    ]
    groups.sort(key=lambda group: -max(_weight(cause) for cause in group))
    said: dict[str, Cause] = {}  # the whole and its parts may say the same
    for number, group in enumerate(groups, 1):
        for cause in group:
            said.setdefault(str(cause), replace(cause, group=number))
    return tuple(said.values())[:MOST]


def _weight(cause: Cause) -> float:
    """Return by what causes are put in order: what they explain, all of it where a block fits only under them."""
    return np.inf if np.isnan(cause.drop) else cause.drop


def _named(search: Search) -> Iterator[Cause]:
    """Yield images with wrong names, and wrong flags."""
    block, variance = search.block, search.last.judgement.sigma0**2
    photos, points = block.photos.ids, block.points.ids
    for renaming in search.renamings:
        old, new = str(points[block.plates.point[renaming.row]]), str(points[renaming.point])
        yield Cause(
            kind=_C.NAME,
            cards=_CARDS[_C.NAME],
            photos=(str(photos[block.plates.photo[renaming.row]]),),
            points=(old, new),
            parameters=2,
            drop=renaming.test**2 * variance,
            test=renaming.test,
            advice=f"it is point {new}: {ADVICE[_C.NAME]}",
        )
    changed = {str(points[flag.point]) for flag in search.flags}
    for finding in flag_findings(search):
        yield Cause(
            kind=_C.FLAG,
            cards=_CARDS[_C.FLAG],
            points=(finding.point,),
            component=finding.blunder.value,
            size=finding.size,
            unit="m",
            parameters=1,
            drop=finding.test**2 * variance if finding.point in changed else 0.0,
            test=finding.test,
            advice=ADVICE[_C.FLAG],
        )


def cause_of(block: Block, sigma0: float, rival: Rival) -> Cause:
    """Return a hypothesis in words."""
    hypothesis = rival.hypothesis
    unit = "" if hypothesis.kind in _NO_UNIT + _NO_SIZE else _UNITS.get(hypothesis.kind, "m")
    scale = {"um": MICROMETRE, "arc sec": ARC_SECOND}.get(unit, 1.0)
    size, sigma = hypothesis.error / scale, hypothesis.sigma * sigma0 / scale
    if hypothesis.kind in _NO_SIZE:
        size = sigma = np.zeros(0)
    elif hypothesis.kind is _C.UNIT:
        size, sigma = 1.0 / (1.0 - hypothesis.error), np.full(1, np.nan)
    shown = 3 if hypothesis.kind is _C.STATION else len(size)
    return Cause(
        kind=hypothesis.kind,
        cards=_cards(block, hypothesis),
        photos=tuple(block.photos.ids[list(hypothesis.photo)].tolist()),
        points=tuple(block.points.ids[list(hypothesis.point)].tolist()),
        component=_component(block, hypothesis),
        size=tuple(size[:shown].tolist()),
        sigma=tuple(sigma[:shown].tolist()),
        unit=unit,
        parameters=hypothesis.parameters,
        drop=rival.drop,
        test=float(np.sqrt(max(rival.drop, 0.0) / max(hypothesis.parameters, 1)) / sigma0),
        rank=rival.rank,
        advice=_advice(hypothesis),
    )


def control_card(block: Block) -> str:
    """Return the mnemonic of the control cards of a block."""
    return "CTG" if block.options.system is CoordinateSystem.GEOGRAPHIC else "CTX"


def _cards(block: Block, hypothesis: Hypothesis) -> tuple[str, ...]:
    """Return the mnemonics of the cards to read again."""
    control = control_card(block)
    station = {"CTG": "STA", "CTX": "STX"}[control]
    match hypothesis.kind:
        case _C.VERTICAL | _C.HORIZONTAL | _C.CONTROL | _C.EXCHANGED_CONTROL:
            return (control,)
        case _C.POSITION:
            return (station,)
        case _C.STATION | _C.START:
            return (station, "ATT")
        case _C.UNIT if hypothesis.member == revisions.PLATES_TO_FOCAL_LENGTH:
            return ("PLT", "CAM")
        case _C.UNIT:
            return (station,) if hypothesis.member == revisions.STATIONS else (control,)
        case _C.AXES if hypothesis.member in (revisions.CONTROL_EXCHANGED, revisions.HEIGHTS_NEGATED):
            return (control,)
        case _C.AXES:
            return ("PLT",)
        case _C.LABELS:
            return (station,) if hypothesis.member == CARDS else ("PLT",)
    return _CARDS[hypothesis.kind]


def _component(block: Block, hypothesis: Hypothesis) -> str:
    match hypothesis.kind:
        case _C.PRINCIPAL_POINT:
            return "xy"[hypothesis.member % 2]
        case _C.UNIT:
            return _WHOSE[hypothesis.member][0]
        case _C.AXES:
            return _AXES[hypothesis.member][0]
        case _C.LABELS:
            return "station cards" if hypothesis.member == CARDS else "plate cards"
        case _C.TIDES:
            return hypothesis.name or "all photos"
    return _COMPONENTS.get(hypothesis.kind, "")


def _advice(hypothesis: Hypothesis) -> str:
    if hypothesis.kind is _C.AXES:
        return f"{_AXES[hypothesis.member][1]}{f'; {hypothesis.name}' if hypothesis.name else ''}"
    if hypothesis.kind is _C.UNIT:
        whose, others = _WHOSE[hypothesis.member]
        factor = 1.0 / (1.0 - float(hypothesis.error[0]))
        feet = {1: f"{whose} in feet, all else in metres", -1: f"{whose} in metres, all else in feet"}
        power = round(np.log(factor) / np.log(revisions.FEET))
        near = abs(factor / revisions.FEET**power - 1.0) < UNIT and hypothesis.member in (
            revisions.CONTROL, revisions.STATIONS, revisions.HEIGHTS,
        )  # fmt: skip
        if near and power in feet:
            return f"{feet[power]}: read the unit again"
        of_plates = hypothesis.member == revisions.PLATES_TO_FOCAL_LENGTH
        for value, unit in (_UNITS_OF_PLATES if of_plates else _UNITS_OF_GROUND).items():
            if abs(factor / value - 1.0) < UNIT:
                right = "millimetres" if of_plates else "metres"
                return f"{whose} in {unit}, {others} in {right}: read the unit again"
        times = f"{whose} {factor:.5g} times what {others} want{'s' if others.startswith('the') else ''}"
        return f"{times}: read both units again"
    if hypothesis.kind is _C.LABELS:
        which = "station cards" if hypothesis.member == CARDS else "plate cards"
        return f"exchange the photo ids on the {which} of the two photos"
    return ADVICE[hypothesis.kind]
