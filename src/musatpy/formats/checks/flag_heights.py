"""Flags of points held against what is given of their heights and of the water, before anything is adjusted."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.errors import Problem
from musatpy.formats.checks.system_use import fits_system
from musatpy.formats.draft import Draft
from musatpy.model import ControlKind, CoordinateSystem, Program, Refraction, Treatment, WaterLevel


def tides_without_flags(draft: Draft) -> Iterator[Problem]:
    """Yield the first tide of a deck in which no point is flagged as submerged, unless refraction is NONE."""
    tides = len(draft.rows["tides"])
    if not tides or not len(draft.rows["plates"]) or draft.options.refraction is Refraction.NONE:
        return
    if not draft.bathymetric.any():
        cards = f"{tides} {draft.card('tides') if tides == 1 else draft.cards('tides') + ' cards'}"
        message = f"{cards}, and no point is flagged as submerged: nothing is refracted (run --submerged)"
        yield draft.problem("tides", 0, message, severity="warning")


def control(draft: Draft) -> Iterator[Problem]:
    """Yield the control whose given height contradicts its flag, by the limits of adjusted heights.

    Not in geocentric jobs, nor where the water is tilted or the level of a photo is unknown; waves may be as high
    as all their crests together.
    """
    if draft.system is CoordinateSystem.GEOCENTRIC or not fits_system(draft, "control", "control.position").all():
        return
    if (draft.options.program is Program.IIA and draft.options.refraction is Refraction.NONE) or _is_tilted(draft):
        return
    tide, tide_sigma = (draft.by_photo("tides", f"photos.{name}") for name in ("tide", "tide_sigma"))
    if draft.options.water_level is WaterLevel.KNOWN:
        tide_sigma = np.nan_to_num(tide_sigma)
    photo, point = draft.photo["plates"], draft.point["plates"]
    seen = np.flatnonzero((photo >= 0) & (point >= 0))
    lowest, highest, sigma = np.full((3, len(draft.point_ids)), np.nan)
    for bound, values, extreme in ((lowest, tide, np.fmin), (highest, tide, np.fmax), (sigma, tide_sigma, np.fmax)):
        extreme.at(bound, point[seen], values[photo[seen]])
    waves = float(np.nansum(np.abs(draft.rows["waves"]["waves.height"]))) / 2.0
    rows, of = draft.rows["control"], draft.point["control"]
    wet, dry = (np.append(flags, False)[of] for flags in (draft.bathymetric, draft.flagged("points.dry")))
    lowest, highest, sigma = (np.append(bound, np.nan)[of] for bound in (lowest, highest, sigma))
    height, kind = rows["control.position"][:, 2], rows["control.kind"]
    given = np.where(rows["control.fixed"].astype(bool), 0.0, rows["control.sigma"][:, 2])
    given[(kind == ControlKind.HORIZONTAL) | dry] = np.nan  # an approximate height, and one that says nothing
    beyond = np.where(wet, height - highest, lowest - height) - waves
    tested = np.isfinite(beyond) & np.isfinite(given) & np.isfinite(sigma)
    if not (beyond[tested] > 0.0).any():
        return
    from musatpy.statistics.gates import FINEST, flag_limit  # most decks have no such point

    sigmas = beyond / np.maximum(np.hypot(given, sigma), FINEST)
    for row in np.flatnonzero(tested & (sigmas > flag_limit(int(tested.sum())))).tolist():
        says = (
            "above the water of all its photos, and" if wet[row] else "below the water of all its photos, and not"
        )
        message = (
            f"point {draft.names('points', 'control')[row]}, {height[row]:g} m: {beyond[row]:.2f} m "
            f"({sigmas[row]:.1f} sigmas) {says} flagged as submerged"
        )
        yield draft.problem("control", row, message, path="control.position", component=2, severity="warning")


def _is_tilted(draft: Draft) -> bool:
    """Return whether the water stands elsewhere at a point than at its photos."""
    if draft.options.water_tilt is not Treatment.KNOWN:
        return True
    rows = draft.rows["water"]
    tilts = (rows[f"water.tilt_{axis}"] for axis in ("east", "north"))
    return any(np.nan_to_num(tilt).any() for tilt in tilts)
