"""What is kept of a deck that is expected to be unusable: what the program says of it."""

from __future__ import annotations

from pathlib import Path

from musatpy.campaign.job import Outcome, State
from musatpy.errors import of_each_kind, printable
from musatpy.runs import ExitStatus


def is_failure(outcome: Outcome) -> bool:
    """True for a deck that was read and cannot be used: whatever else went wrong may go right another time."""
    return outcome.state is State.UNUSABLE and outcome.deck_sha256 is not None


def messages_of(name: str, deck: Path, outcome: Outcome) -> bytes:
    """Return state, exit status and every message of a run as text, in which the deck has its name in the baseline.

    So the text depends neither on the place of the baseline nor on the folder in which the program is started.
    """
    said = [problem.render() for problem in of_each_kind(outcome.problems)]
    head = f"{outcome.state}, exit status {int(ExitStatus.UNUSABLE)}: {outcome.message}"
    text = "\n".join([head, *said]).replace(str(deck), name)
    return f"{printable(text)}\n".encode()
