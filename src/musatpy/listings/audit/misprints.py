"""What an audit finds: a contradiction, and the cells one of which must be wrong."""

from __future__ import annotations

from dataclasses import dataclass

from musatpy.listings.audit.structures import Printed


@dataclass(frozen=True)
class Suspect:
    """A cell that, were it another number, would leave no contradiction."""

    item: str
    line: int
    found: str
    expected: str = ""  # a number, `A to B`, or empty where the others do not tell

    @classmethod
    def of(cls, item: str, cell: Printed, expected: str = "") -> Suspect:
        """Return a printed cell as one."""
        return cls(item, cell.line, cell.text, expected)


@dataclass(frozen=True)
class Misprint:
    """One contradiction in a listing."""

    line: int
    table: str
    item: str
    message: str
    suspects: tuple[Suspect, ...] = ()

    def lines(self, listing: str) -> list[str]:
        """Return the finding in print, a line for each suspect below it."""
        text = [f"{listing}:{self.line}: {self.table}: {self.item}: {self.message}"]
        for number, suspect in enumerate(self.suspects):
            expected = f", expected {suspect.expected}" if suspect.expected else ""
            lead = "    either" if number == 0 and len(self.suspects) > 1 else "    or    " if number else "   "
            text.append(f"{lead} {suspect.item} {suspect.found}{expected} (line {suspect.line})")
        return text


def text_like(value: float, like: Printed) -> str:
    """Return a number in the form of another: degrees, minutes, seconds, or with its decimals."""
    places = len(like.text.split()[-1].partition(".")[2])
    fields = []
    if len(like.text.split()) == 3:
        ticks = round(abs(value) * 10**places)
        minutes, rest = divmod(ticks, 60 * 10**places)
        degrees, minutes = divmod(minutes, 60)
        sign = "-" if value < 0.0 and ticks else ""
        fields = [f"{sign}{degrees}", str(minutes)]
        value = rest / 10**places
    number = f"{value:.{places}f}"
    if not number.strip("-.0"):
        number = number.removeprefix("-")
    return " ".join([*fields, number.replace("0.", ".", 1) if number.lstrip("-").startswith("0.") else number])


def range_like(low: float, high: float, like: Printed) -> str:
    """Return a range in the form of a cell: one number where both ends print the same."""
    first, last = text_like(low, like), text_like(high, like)
    return first if first == last else f"{first} to {last}"
