"""Heights of the water at times of exposure, out of the readings of a gauge, and the cards that say them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from musatpy.arrays import FloatArray
from musatpy.errors import DeckError, Problem
from musatpy.formats.cards.codec import bytes_of, text_of
from musatpy.formats.cards.deck import CardDeck, read_cards
from musatpy.formats.cards.settings import blank_card, card_with, setting_of
from musatpy.formats.cards.spec import END_MNEMONIC, CardSpec, Family
from musatpy.pointfiles.columns import FileColumn, Wanted
from musatpy.pointfiles.point_tables import PointTable, read_table

LONGEST_GAP = 1800.0  # s between two readings: beyond it the water may have done anything
_FEWEST = 3  # readings: one is left out to see what a gap is worth
_ZONE = re.compile(r"([+-])(\d\d):?(\d\d)")
_READINGS = Wanted(
    columns=(
        FileColumn(name="time", aliases=("t", "date", "datetime"), kind="text", expected="a time"),
        FileColumn(name="height", aliases=("level", "water", "tide", "z", "value"), unit="m"),
    )
)
_EXPOSURES = Wanted(
    columns=(
        FileColumn(name="photo", aliases=("id", "name", "image"), kind="text", unique=True, expected="a photo"),
        FileColumn(name="time", aliases=("t", "date", "datetime"), kind="text", expected="a time"),
    )
)


@dataclass(frozen=True, kw_only=True, eq=False)
class TideSeries:
    """k readings of a gauge: times (k,) s, ascending, and heights of the water (k,) m with one sigma."""

    time: FloatArray
    height: FloatArray
    sigma: float = 0.0  # m, of one reading

    def at(self, time: FloatArray) -> tuple[FloatArray, FloatArray, list[str]]:
        """Return the heights (n,) m at times (n,) s, their sigmas (n,) m, and why there is none, else ''.

        By the piecewise cubic of Fritsch and Carlson, which has no crests of its own. The sigma joins that of a
        reading with that of the gap: the readings are interpolated without one of them at a time, and what they are
        missed by, root mean square, goes with the square of the length of the gap; it is nothing at a reading.
        """
        gap = np.diff(self.time)
        row = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(gap) - 1)
        part = (time - self.time[row]) / gap[row]
        reasons = ["no time of exposure" if lost else "" for lost in np.isnan(time).tolist()]
        for which, reason in (
            (time < self.time[0], "before the first reading"),
            (time > self.time[-1], "after the last reading"),
            ((gap[row] > LONGEST_GAP) & ~np.isin(time, self.time), "in a gap of more than 30 minutes"),
        ):
            reasons = [old or reason * bool(new) for old, new in zip(reasons, which.tolist(), strict=True)]
        known = np.array([not reason for reason in reasons], dtype=bool)
        height, of_gap = np.full((2, len(time)), np.nan)
        height[known] = PchipInterpolator(self.time, self.height)(time[known])
        of_gap[known] = (self.missed_by * np.square(gap[row]) * 4.0 * part * (1.0 - part))[known]
        return height, np.hypot(self.sigma, of_gap), reasons

    @property
    def missed_by(self) -> float:
        """What readings are missed by without them, root mean square, over the square of their two gaps; m/s2."""
        t, h, off = self.time, self.height, list[float]()
        for row in range(1, len(t) - 1):  # a piece depends on two readings to each side
            near = np.setdiff1d(np.arange(max(0, row - 3), min(len(t), row + 4)), row)
            off.append(float(PchipInterpolator(t[near], h[near])(t[row]) - h[row]))
        return float(np.sqrt(np.mean(np.square(np.array(off) / np.square(t[2:] - t[:-2])))))


def read_series(path: Path, *, zone: str = "", datum: float = 0.0, sigma: float = 0.0) -> TideSeries:
    """Return the readings of a table of `time` and `height` (m above the zero of the gauge, which is at `datum`).

    Times are seconds, or as ISO 8601 writes them; `zone` (UTC or +hh:mm) holds where they say none. Raises
    `DeckError` with all that is wrong, by line and column, and `OSError`.
    """
    table = read_table(path, _READINGS)
    time = _times(table, zone)
    for row in np.flatnonzero(~(np.diff(time) > 0.0)).tolist():
        if np.isfinite(time[row : row + 2]).all():
            table.refuse("not later than the reading before it", row + 1, "time")
    if not table.problems and len(time) < _FEWEST:
        table.refuse(f"{len(time)} readings: {_FEWEST} at least are needed")
    table.require(DeckError)
    return TideSeries(time=time, height=table.numbers("height") + datum, sigma=sigma)


def read_exposures(path: Path, zone: str = "") -> dict[str, float]:
    """Return the times (s) of exposures of a table of `photo` and `time`, by photo; raises as `read_series`."""
    table = read_table(path, _EXPOSURES)
    time = _times(table, zone)
    table.require(DeckError, empty="no photos")
    return dict(zip(table.texts("photo"), time.tolist(), strict=True))


def moment(text: str, zone: str = "") -> float:
    """Return a time in seconds: a number as it is; of ISO 8601 since 1970 in UTC. Raises `ValueError`."""
    with suppress(ValueError):
        return float(text)
    stated = datetime.fromisoformat(text)
    if stated.tzinfo is None:
        if not zone:
            raise ValueError("has no zone: --zone says which, such as UTC or +02:00")
        stated = stated.replace(tzinfo=_zone(zone))
    return stated.timestamp()


def _zone(text: str) -> timezone:
    if text.upper() in ("UTC", "Z"):
        return UTC
    parts = _ZONE.fullmatch(text)
    if parts is None:
        raise ValueError(f"zone '{text}' is not UTC or +hh:mm")
    offset = timedelta(hours=int(parts[2]), minutes=int(parts[3]))
    return timezone(-offset if parts[1] == "-" else offset)


def _times(table: PointTable, zone: str) -> FloatArray:
    """Return the times (n,) of a table, NaN for those that are wrong, which are told."""
    times = np.full(len(table.rows), np.nan)
    if not table.has("time"):
        return times
    for row, text in enumerate(table.texts("time")):
        try:
            times[row] = moment(text, zone)
        except ValueError as error:
            table.refuse(f"'{text}' {error}" if "zone" in str(error) else f"'{text}' is no time", row, "time")
    return times


def deck_with_tides(
    data: bytes, family: Family, series: TideSeries, exposures: Mapping[str, float] | None, *, clock: float = 0.0
) -> tuple[bytes, dict[str, tuple[float, float]]]:
    """Return a deck with the tides of its photos on their cards, and these by photo: height and sigma (m).

    `exposures`: times by photo; None: those on the cards of tides, which count from `clock` (s). All other columns
    and cards stay as they are; a photo without a card gets one before the END. Raises `DeckError` with every photo
    that has no tide.
    """
    deck = read_cards(data, family)
    spec, fields = _card_of_tides(family)
    photos = _photos(deck, family)
    on_cards = {photo: row for row, photo in enumerate(deck.tables[spec.mnemonic][fields["photos.ids"]].tolist())}
    if exposures is None:
        times = deck.tables[spec.mnemonic][fields["photos.time"]]
        exposures = {photo: float(times[row]) + clock for photo, row in on_cards.items()}
    height, sigma, reasons = series.at(np.array([exposures.get(photo, np.nan) for photo in photos]))
    lost = [(photo, reason) for photo, reason in zip(photos, reasons, strict=True) if reason]
    if lost:
        raise DeckError([Problem(message=f"photo {photo}: {reason}") for photo, reason in lost])
    text, encoding = text_of(data)
    lines = re.findall(r"[^\n]*\n|[^\n]+", text)
    new = list[str]()
    for photo, *values in zip(photos, height.tolist(), sigma.tolist(), strict=True):
        named = zip(("photos.tide", "photos.tide_sigma"), values, strict=True)
        settings = [setting_of(spec, fields[target], f"{value:.4f}") for target, value in named]
        if photo in on_cards:
            line = int(deck.lines[spec.mnemonic][on_cards[photo]]) - 1
            card = lines[line].rstrip("\r\n")
            lines[line] = card_with(card, settings) + lines[line][len(card) :]
        else:
            name = setting_of(spec, fields["photos.ids"], photo)
            new.append(card_with(blank_card(spec), [name, *settings]).rstrip() + "\n")
    end = next((row for row, line in enumerate(lines) if line.startswith(END_MNEMONIC)), len(lines))
    data = bytes_of("".join([*lines[:end], *new, *lines[end:]]), encoding)
    return data, dict(zip(photos, zip(height.tolist(), sigma.tolist(), strict=True), strict=True))


def _card_of_tides(family: Family) -> tuple[CardSpec, dict[str, str]]:
    """Return the card of a family that has the tides, and its fields by what they are of a block."""
    for spec in family.cards.values():
        fields = {field.target: field.name for field in spec.fields}
        if "photos.tide" in fields:
            return spec, fields
    raise DeckError.of("no card of these formats has a tide")


def _photos(deck: CardDeck, family: Family) -> list[str]:
    """Return the photos of a deck, in the order of its cards."""
    named = [
        (spec.mnemonic, field.name)
        for spec in family.cards.values()
        for field in spec.fields
        if field.target == "photos.ids"
    ]
    return list(dict.fromkeys(photo for card, name in named for photo in deck.tables[card][name].tolist() if photo))
