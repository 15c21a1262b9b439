"""A printed line -> numbers and words, each number as the decimal that stands on paper.

Numbers are read as FORTRAN prints them: E and D exponents, a bare exponent of three digits (`.1234-105`), no digit
before the point, numbers run together (`1.234-5.678`), asterisks for what did not fit. Values are decimals, so that
1.234 and 1.233 differ by exactly .001.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from decimal import Decimal, InvalidOperation
from functools import lru_cache
from typing import Literal, NamedTuple

Kind = Literal["number", "angle", "word", "overflow"]

# A bare exponent has three digits from 100 on, behind at most one digit before the point: all else with a sign in
# it is the next number.
_PLAIN = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDdQq][+-]?\d{1,4}(?![.\w]))?"
_BARE = r"[+-]?\d?\.\d+[+-][1-4]\d\d(?![.\d])"
_FIXED = re.compile(r"[+-]?\d*\.\d+", re.ASCII)
_PIECE = re.compile(rf"{_BARE}|{_PLAIN}|\*+")
_BEFORE, _BEHIND = "([{<\"'=~:,;", ")]}>\"',;:%!?"  # marks that a number may stand between
_PARTS = re.compile(r"([=:,;/()\[\]{}\"'<>]+)")
_CHUNK = re.compile(r"\S+")
_BARE_EXPONENT = re.compile(r"(?<=[\d.])[+-]\d{3}$")
_DEGREES = re.compile(r"[+-]?\d{1,3}")
_MINUTES = re.compile(r"\d{1,2}")
_SECONDS = re.compile(r"\d{0,2}\.\d*|\d{1,2}")


class Token(NamedTuple):
    """One number or word. An angle is three fields, its value in arc seconds; an overflow is asterisks."""

    kind: Kind
    text: str
    value: Decimal | None = None
    step: int = 0  # power of ten of the last printed digit, of the seconds for an angle

    @property
    def negative_degrees(self) -> bool:
        """True for `-0`: only degrees are printed so, with the sign of their minutes and seconds."""
        return self.text == "-0"


class PlacedToken(NamedTuple):
    """A token and the columns of print that it takes, counted from 0, the end not included."""

    token: Token
    start: int
    end: int


def tokens_of(text: str) -> list[PlacedToken]:
    """Return the tokens of a line in their order."""
    tokens: list[PlacedToken] = []
    for chunk in _CHUNK.finditer(text):
        start = chunk.start()
        for token in parse(chunk[0]):
            end = start + len(token[1])
            tokens.append(PlacedToken(token, start, end))
            start = end
    return tokens


def parse(chunk: str) -> tuple[Token, ...]:
    """Return the tokens of a piece of text without blanks; together they have all of its characters."""
    if _FIXED.fullmatch(chunk):  # nearly every number of a listing
        return (Token._make(("number", chunk, Decimal(chunk), chunk.index(".") + 1 - len(chunk))),)
    return _parsed(chunk)


def begins_with_number(chunk: str) -> bool:
    """Tell whether the first token of a piece of text is no word."""
    return _FIXED.fullmatch(chunk) is not None or _parsed(chunk)[0].kind != "word"


@lru_cache(maxsize=1 << 16)
def _parsed(chunk: str) -> tuple[Token, ...]:
    if chunk == "*":  # a mark; what does not fit one column is not worth a number
        return (Token("word", chunk),)
    if numbers := _numbers(chunk):
        return numbers
    if not any(character.isdigit() for character in chunk):
        return (Token("word", chunk),)
    bare = chunk.lstrip(_BEFORE)
    inside = bare.rstrip(_BEHIND)
    inside = inside.removesuffix(".") if inside == bare else inside
    if inside != chunk and _numbers(inside):
        return tuple(_with_marks([chunk[: len(chunk) - len(bare)], inside, bare[len(inside) :]]))
    parts = _PARTS.split(chunk)
    if any(_numbers(part) for part in parts):
        return tuple(_with_marks(parts))
    return (Token("word", chunk),)


def _numbers(text: str) -> tuple[Token, ...]:
    """Return the numbers and asterisks that a text is made of; nothing where there is anything else in it."""
    pieces = _PIECE.findall(text)
    return tuple(_number(piece) for piece in pieces) if "".join(pieces) == text else ()


def _with_marks(parts: Sequence[str]) -> Iterator[Token]:
    for part in parts:
        if part:
            yield from _numbers(part) or (Token("word", part),)


def _number(text: str) -> Token:
    if text[0] == "*":
        return Token("overflow", text)
    plain = text.upper().replace("D", "E").replace("Q", "E")
    if "E" not in plain:
        plain = _BARE_EXPONENT.sub(lambda match: f"E{match[0]}", plain)
    mantissa, _, exponent = plain.partition("E")
    try:
        value = Decimal(plain)
    except InvalidOperation:  # an exponent beyond all reason
        return Token("word", text)
    _, point, decimals = mantissa.partition(".")
    return Token("number", text, value, int(exponent or 0) - (len(decimals) if point else 0))


def angle_of(tokens: Sequence[Token]) -> Token | None:
    """Return degrees, minutes and seconds as one angle in arc seconds; None where the three are none.

    The sign sits on the degrees, zero degrees included: `-0 30 45.2` is negative.
    """
    if len(tokens) != 3:
        return None
    degrees, minutes, seconds = (token.text for token in tokens)
    if not (_DEGREES.fullmatch(degrees) and _MINUTES.fullmatch(minutes) and _SECONDS.fullmatch(seconds)):
        return None
    if int(minutes) >= 60 or tokens[2].value is None or tokens[2].value > 60:
        return None
    size = abs(int(degrees)) * 3600 + int(minutes) * 60 + tokens[2].value
    return Token("angle", f"{degrees} {minutes} {seconds}", -size if degrees[0] == "-" else size, tokens[2].step)


def with_angles(placed: Sequence[PlacedToken]) -> list[PlacedToken]:
    """Return the tokens with every degrees, minutes and seconds among them taken together; seconds have a point."""
    tokens: list[PlacedToken] = []
    place = 0
    while place < len(placed):
        three = placed[place : place + 3]
        angle = angle_of([placed.token for placed in three]) if "." in three[-1].token.text else None
        if angle is None:
            tokens.append(three[0])
            place += 1
        else:
            tokens.append(PlacedToken(angle, three[0].start, three[-1].end))
            place += 3
    return tokens
