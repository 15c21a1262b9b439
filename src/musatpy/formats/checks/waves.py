"""Waves on the water: what their cards must say, and what they need of others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.errors import Problem
from musatpy.formats.assembly import waves_of
from musatpy.formats.checks.check import check
from musatpy.formats.checks.references import unknown
from musatpy.formats.draft import Draft
from musatpy.model import CoordinateSystem, Datum, Editing, Program, Refraction, Treatment, WaveShape
from musatpy.model.water import WAVE_SIGMAS

_PERIODS = 100.0  # from time 0; a thousandth of so many is a tenth of a length


@check()
def sigmas_of_no_wave(draft: Draft) -> Iterator[Problem]:
    """Yield sigmas of no wave."""
    message = f"wave {{}} has no {draft.card('waves')}"
    yield from unknown(draft, "wave_sigmas", "waves.ids", draft.rows["waves"]["waves.ids"], message)


@check()
def origin(draft: Draft) -> Iterator[Problem]:
    """Yield waves without the place from which their crests count, a second such place, and one without waves."""
    waves, places = len(draft.rows["waves"]), len(draft.rows["wave_origin"])
    card = draft.card("wave_origin")
    if waves and not places:
        message = f"waves, and no {card} with the place from which their crests count"
        yield draft.problem("waves", 0, message)
    for row in range(1, places):
        message = f"a second origin of the waves; the first is {draft.place('wave_origin', 0)}"
        yield draft.problem("wave_origin", row, message)
    if places and not waves:
        message = f"an origin of waves, and no {draft.card('waves')}: it takes no part"
        yield draft.problem("wave_origin", 0, message, severity="warning")


@check(of_card=True, needs="waves")
def parameters(draft: Draft) -> Iterator[Problem]:
    """Yield waves that say too much or too little, that break, or that the theory of their shape does not know."""
    from musatpy.sea.deck_waves import faults  # most decks have none

    for row, name, message, wrong in faults(waves_of(draft)):
        path = f"waves.{name}"
        if not draft.unread("waves", path)[row]:
            yield draft.problem("waves", row, message, path=path, severity="error" if wrong else "warning")


@check(needs="waves")
def programs(draft: Draft) -> Iterator[Problem]:
    """Yield what excludes waves: a refraction that knows none, and a tilt of the water."""
    options = draft.options
    if options.program is Program.IIA and options.refraction is not Refraction.RIGOROUS:
        role = "options" if len(draft.rows["options"]) else "waves"
        path = "options.refraction" if role == "options" else ""
        needed = f"waves need refraction {Refraction.RIGOROUS}, or program {Program.IIIA}"
        message = f"{needed}: {options.refraction} knows none"
        yield draft.problem(role, 0, message, path=path)
    why = "waves need level water: they cannot be combined with a tilt"
    if options.water_tilt is Treatment.ADJUST:
        yield draft.problem("more_options", 0, why, path="options.water_tilt")
    paths = [
        path for path in ("water.tilt_east", "water.tilt_north") if np.nan_to_num(draft.rows["water"][path]).any()
    ]
    for path in paths[:1]:
        yield draft.problem("water", 0, why, path=path)


@check()
def unknown_waves(draft: Draft) -> Iterator[Problem]:
    """Yield sigmas of waves that cannot be unknown, by datum, editing, or the shape of a wave.

    Program IIA propagates them, which asks for waves of the same shape.
    """
    sigmas, options = draft.rows["wave_sigmas"], draft.options
    positive = {name: sigmas[f"waves.{name}"] > 0.0 for name in WAVE_SIGMAS}
    doubtful = np.any(list(positive.values()), axis=0)
    reasons, adjusted = [], options.program is Program.IIIA
    if adjusted and options.datum is Datum.FREE:
        reasons.append("such waves need control, not a free network")
    if adjusted and options.editing is not Editing.NONE:
        reasons.append(f"such waves cannot be combined with the editing {options.editing}: search with known waves")
    for row in np.flatnonzero(doubtful).tolist():
        name = next(one for one in WAVE_SIGMAS if positive[one][row])
        for reason in reasons:
            message = f"a sigma makes wave {sigmas['waves.ids'][row]} unknown: {reason}"
            yield draft.problem("wave_sigmas", row, message, path=f"waves.{name}")
    waves = draft.rows["waves"]
    for row in np.flatnonzero(~np.isin(waves["waves.shape"], ("", WaveShape.SINUSOIDAL))).tolist():
        if doubtful.any() and not draft.unread("waves", "waves.shape")[row]:
            line = int(sigmas.lines[np.flatnonzero(doubtful)[0]])
            message = f"where waves have sigmas (line {line}), all of them are sinusoidal ({WaveShape.SINUSOIDAL})"
            yield draft.problem("waves", row, message, path="waves.shape")


@check(needs="waves")
def times(draft: Draft) -> Iterator[Problem]:
    """Yield the tides without the time of their exposure, which says where the crests are."""
    path = "photos.time"
    blank = np.isnan(draft.rows["tides"][path]) & ~draft.unread("tides", path)
    message = "photo {}: blank, and waves need the time of every exposure above water"
    yield from draft.problems("tides", blank, message, draft.names("photos", "tides"), path=path)


@check(needs="waves")
def clock(draft: Draft) -> Iterator[Problem]:
    """Yield the latest exposure where it is so late that nobody knows where the crests are by then."""
    time = draft.rows["tides"]["photos.time"]
    if not np.isfinite(time).any():
        return
    from musatpy.sea.deck_waves import wave_trains  # most decks have none

    shortest = float(np.nanmin([*wave_trains(waves_of(draft)).period, np.inf]))
    row = int(np.nanargmax(np.abs(time)))
    if abs(time[row]) > _PERIODS * shortest > 0.0:
        late = abs(time[row]) / shortest
        message = (
            f"{time[row]:g} s: {late:.0f} periods from time 0, for which crests are given; a period wrong by a "
            f"thousandth moves them by {late / 1000.0:.1g} of a length"
        )
        yield draft.problem("tides", row, message, path="photos.time", severity="warning")


@check(of_job=True, needs="waves")
def submerged(draft: Draft) -> Iterator[Problem]:
    """Yield waves over no submerged point, and submerged control that a trough may leave dry (not geocentric)."""
    rows = draft.rows["waves"]
    if not np.append(draft.bathymetric, False)[draft.point["plates"]].any():
        yield draft.problem(
            "waves", 0, "waves, and no submerged point is measured: they take no part", severity="warning"
        )
    if draft.system is CoordinateSystem.GEOCENTRIC:
        return
    trough = float(np.nansum(np.abs(rows["waves.height"]))) / 2.0
    lowest = draft.by_photo("tides", "photos.tide") - trough
    height = draft.rows["control"]["control.position"][:, 2]
    for row in np.flatnonzero(draft.rows["control"]["points.bathymetric"]).tolist():
        photos = draft.photo["plates"][draft.point["plates"] == draft.point["control"][row]]
        water = lowest[photos[photos >= 0]]
        if (height[row] > water).any():
            message = (
                f"{height[row]:g} m: submerged, but above the troughs of the waves, down to {np.nanmin(water):g} m"
            )
            path = "control.position"
            yield draft.problem("control", row, message, path=path, component=2, severity="warning")
