"""The cross checks of a deck: what is wrong between cards, or with values that are well written.

What makes the job meaningless or ambiguous is an error, and the job does not run: an identification given twice,
a reference to something that no card defines, a value that cannot be, a part of the block without a datum. What can
be left out and listed, or is odd but possible, is a warning: a photo or a control point without measurements, a
point with a single ray, a plate coordinate outside the format, a heading that the images contradict.

Each check is a function of the draft that yields problems. A field that could not be read is in the deck's problems
already, and no check complains of it again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from musatpy.errors import Problem
from musatpy.formats.checks import (
    datum,
    flag_heights,
    headings,
    identities,
    orientation_card,
    program_options,
    raw,
    references,
    scales,
    system_cards,
    system_use,
    values,
    water_cards,
    wave_cards,
    zeros,
)
from musatpy.formats.draft import Draft

Check = Callable[[Draft], Iterator[Problem]]

CHECKS: tuple[Check, ...] = (
    references.missing_kinds,
    identities.repeated_cards,
    identities.repeated_members,
    references.undefined_cameras,
    references.undefined_photos,
    references.photos_without_camera,
    references.undefined_marks,
    references.photos_without_attitude,
    references.unmeasured,
    values.options,
    values.sigmas,
    values.magnitudes,
    values.sexagesimal,
    values.attitudes,
    values.geographic_positions,
    values.cameras,
    values.distortion,
    water_cards.one_index,
    water_cards.conditions,
    water_cards.index,
    values.bounds,
    values.two_ends,
    values.ellipsoid,
    values.plate_coordinates,
    values.small_plates,
    zeros.plates,
    zeros.marks,
    zeros.positions,
    values.control_components,
    values.equal_elevation_groups,
    values.plates_taken_as_refined,
    system_cards.system_roles,
    system_cards.job_system,
    system_cards.statements,
    system_cards.decimal_angles,
    system_cards.matrices,
    system_use.position_cards,
    system_use.ellipsoid_card,
    system_use.geocentric_positions,
    system_use.local_positions,
    water_cards.flags,
    water_cards.water_card,
    water_cards.tides,
    water_cards.levels,
    flag_heights.tides_without_flags,
    flag_heights.control,
    wave_cards.sigmas,
    wave_cards.origin,
    wave_cards.parameters,
    wave_cards.programs,
    wave_cards.unknown,
    wave_cards.times,
    wave_cards.clock,
    wave_cards.submerged,
    program_options.only_simultaneous,
    program_options.only_rigorous,
    program_options.tide_labels,
    program_options.priors_of_the_water,
    orientation_card.faults,
    raw.lenses,
    raw.distortions,
    raw.calibrations,
    raw.reseaux,
    raw.unmeasured_marks,
    raw.unmeasured_crosses,
    raw.curvature,
    raw.heights,
    raw.flags,
    datum.single_rays,
    datum.photo_rays,
    datum.parts,
    headings.headings,
    scales.scales,
)


# What a deck may lack that is to be merged with others, or edited, before it is run.
OF_A_RUN = frozenset(
    {
        *(raw.calibrations, raw.unmeasured_marks, raw.unmeasured_crosses, raw.heights),
        *(datum.single_rays, datum.photo_rays, datum.parts, headings.headings, scales.scales),
        *(flag_heights.tides_without_flags, flag_heights.control),
    }
)
# What looks at coordinates and attitudes in the words of the adjustment.
OF_THE_JOB = frozenset(
    {
        *(values.attitudes, water_cards.levels, flag_heights.control, wave_cards.submerged),
        *(headings.headings, scales.scales),
    }
)
# What looks at one card, whatever the others say.
OF_A_CARD = frozenset(
    {
        *(values.options, values.sigmas, values.magnitudes, values.sexagesimal, values.attitudes, values.cameras),
        *(values.geographic_positions, values.distortion, values.bounds, values.two_ends, values.ellipsoid),
        *(water_cards.conditions, water_cards.index, raw.lenses, wave_cards.parameters),
    }
)


def check_card(draft: Draft) -> tuple[Problem, ...]:
    """Return the problems of what a card says itself."""
    return tuple(problem for check in CHECKS if check in OF_A_CARD for problem in check(draft))


def cross_check(draft: Draft, *, for_run: bool = True) -> tuple[Problem, ...]:
    """Return the problems that every check finds, in the order of the checks; without a run, not those of a run.

    Where a deck states its coordinates or attitudes in other words than the adjustment has, those are left out that
    look at them: they are for `check_entered`.
    """
    left_out = (frozenset() if for_run else OF_A_RUN) | (frozenset() if draft.given_in is None else OF_THE_JOB)
    return tuple(problem for check in CHECKS if check not in left_out for problem in check(draft))


def check_entered(draft: Draft, *, for_run: bool = True) -> tuple[Problem, ...]:
    """Return the problems of coordinates and attitudes of a draft that was taken in by its statement."""
    checks = (check for check in CHECKS if check in OF_THE_JOB and (for_run or check not in OF_A_RUN))
    return tuple(problem for check in checks for problem in check(draft))
