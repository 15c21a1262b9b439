"""A listing beside a newer run, by meaning: the same statistic of the same id, whatever its page and column.

The newer run is a listing too, or the record NAME.json that `musat run` left.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from musatpy.errors import MusatError
from musatpy.json_files import read_record
from musatpy.listings.audit.listing_numbers import numbers_of
from musatpy.listings.audit.quantities import Key, Quantity, within_half_circle
from musatpy.listings.audit.reading import read_listing
from musatpy.listings.audit.record_numbers import NEEDS, statistics_of_record
from musatpy.listings.audit.structures import Listing


@dataclass(frozen=True, kw_only=True)
class Pair:
    """The same statistic in both."""

    key: Key
    old: Quantity
    new: Quantity

    @property
    def difference(self) -> float | None:
        """New minus old, of angles the smaller way round; None for ids."""
        if self.old.value is None or self.new.value is None:
            return None
        difference = self.new.value - self.old.value
        return within_half_circle(difference) if self.old.unit == "arcsec" else difference

    @property
    def alike(self) -> bool:
        """True where both are the same id, or the same number within the rounding of both prints."""
        if self.difference is None:
            return self.old.text == self.new.text
        return abs(self.difference) <= (self.old.half + self.new.half) * (1.0 + 1e-9)


@dataclass(frozen=True, kw_only=True)
class SideBySide:
    """Two runs by meaning."""

    pairs: tuple[Pair, ...]
    only_old: tuple[Key, ...]
    only_new: tuple[Key, ...]
    several: tuple[Key, ...]  # more than once in one of them, and not the same there: not compared


def side_by_side(old: Listing, path: Path | str) -> SideBySide:
    """Return a listing beside the listing or record of a newer run.

    Raises `MusatError` where the file has nothing to compare with, `OSError` where it cannot be read.
    """
    (first, several_old), (second, several_new) = numbers_of(old), _statistics_in(Path(path))
    runs = {key.refracted for key in second if key.refracted is not None}
    if len(runs) == 1:
        first = _of_run(first, next(iter(runs)))
    several = several_old | several_new
    common = [key for key in first if key in second]
    if not common:
        raise MusatError(f"{path}: has no statistic that is in {old.name} too")
    return SideBySide(
        pairs=tuple(Pair(key=key, old=first[key], new=second[key]) for key in common),
        only_old=tuple(key for key in first if key not in second and key not in several),
        only_new=tuple(key for key in second if key not in first and key not in several),
        several=tuple(sorted(several, key=str)),
    )


def _of_run(statistics: dict[Key, Quantity], refracted: bool) -> dict[Key, Quantity]:
    """Return statistics of reports that do not say their run, as those of the only run there is."""
    if any(key.refracted is not None for key in statistics):
        return statistics
    return {
        replace(key, refracted=refracted)
        if key.report.endswith((" analysis", "plate residuals"))
        else key: quantity
        for key, quantity in statistics.items()
    }


def _statistics_in(path: Path) -> tuple[dict[Key, Quantity], set[Key]]:
    if path.suffix.lower() != ".json":
        return numbers_of(read_listing(path))
    record = read_record(path, NEEDS)
    try:
        return statistics_of_record(record), set()
    except (ValueError, KeyError, TypeError, IndexError, AttributeError) as error:
        raise MusatError(f"{path}: is no record of a run ({type(error).__name__}: {error})") from error
