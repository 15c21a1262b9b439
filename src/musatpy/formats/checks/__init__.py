"""The cross checks of a deck: what is wrong between cards, or with values that are well written.

What makes the job meaningless or ambiguous is an error, and the job does not run: an identification given twice,
a reference to something that no card defines, a value that cannot be, a part of the block without a datum. What can
be left out and listed, or is odd but possible, is a warning: a photo or a control point without measurements, a
point with a single ray, a plate coordinate outside the format, a heading that the images contradict.

Each check is a function of the draft that yields problems (`check`). A field that could not be read is in the
problems of the deck already, and no check complains of it again.
"""

from __future__ import annotations

from importlib import import_module

from musatpy.errors import Problem
from musatpy.formats.checks.check import DeckCheck
from musatpy.formats.draft import Draft

_SUBJECTS = "references values plates places systems water waves sensors datum images ports"
_MODULES = (import_module(f"{__name__}.{subject}") for subject in _SUBJECTS.split())
_EVERY = (one for module in _MODULES for one in vars(module).values() if isinstance(one, DeckCheck))
CHECKS = tuple(dict.fromkeys(_EVERY))  # some look at what others find


def check_card(draft: Draft) -> tuple[Problem, ...]:
    """Return the problems of what a card says itself."""
    return tuple(problem for check in CHECKS if check.of_card for problem in check(draft))


def cross_check(draft: Draft, *, for_run: bool = True) -> tuple[Problem, ...]:
    """Return the problems that every check finds, in the order of the checks; without a run, not those of a run.

    Where a deck states its coordinates or attitudes in other words than the adjustment has, those are left out that
    look at them: they are for `check_entered`.
    """
    checks = [check for check in CHECKS if draft.given_in is None or not check.of_job]
    return tuple(problem for check in checks if for_run or not check.of_run for problem in check(draft))


def check_entered(draft: Draft, *, for_run: bool = True) -> tuple[Problem, ...]:
    """Return the problems of coordinates and attitudes of a draft that was taken in by its statement."""
    checks = [check for check in CHECKS if check.of_job and (for_run or not check.of_run)]
    return tuple(problem for check in checks for problem in check(draft))
