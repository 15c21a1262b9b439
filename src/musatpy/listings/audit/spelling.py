"""Words that are known beforehand (titles, labels, ids) under the noise of a scan, and which repair each takes.

Noise is what `words` repairs in numbers: 1 and 0 as letters or letters as these, stray characters, broken words.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache

from musatpy.listings.audit.structures import Repair, RepairKind

_LIKE = {**dict.fromkeys("liI1|!", "[liI1|!]"), **dict.fromkeys("oO0", "[oO0]")}
_SAME = str.maketrans("liI|!Oo", "1111100")
# The same, letters and digits alone: of ASCII at one go, of which most listings are.
_BARE = {n: None for n in range(128) if not chr(n).isalnum()} | _SAME
_BARE_ROWS = "".join(map(chr, range(128))).casefold().translate(_SAME).encode("ascii").ljust(256)
_NO_LETTERS = bytes(n for n, same in _BARE.items() if same is None and n != ord("\n"))
_NO_LETTER = re.compile(r"[\W_]+")
_BETWEEN = r"[\W_]?"  # one stray character, or a break
_LEAST = 4  # letters that tell whether it is worth while to look for all
_SYNTAX = re.compile(r"\(\?:|[()?|]|.")


@lru_cache(maxsize=4096)
def canonical(text: str) -> str:
    """Return a phrase without what noise or case can change: letters and digits that look alike are one."""
    return lookalike(text.casefold())


def canonical_rows(rows: Sequence[str]) -> list[str]:
    """Return the canonical form of each row, nothing where it has no letter but what noise makes of digits."""
    text = "\n".join(rows)
    if text.isascii():  # of most listings: all rows at one go
        bare = text.encode("ascii").translate(_BARE_ROWS, _NO_LETTERS).decode("ascii").split("\n")
    else:
        bare = [lookalike(row.casefold()) for row in rows]
    return ["" if row.isdecimal() else row for row in bare]


def lookalike(text: str) -> str:
    """Return a name without what noise can change; its case is its own: L is no 1, l may be."""
    return (text.translate(_BARE) if text.isascii() else _NO_LETTER.sub("", text.translate(_SAME))).casefold()


@lru_cache(maxsize=256)
def pattern(phrase: str) -> str:
    """Return a pattern of a phrase with any blanks, points, commas and hyphens between its words.

    The phrase may have groups `(?:this|that)` and `(?:all)?`.
    """
    return r"[\s.,\-]*".join(re.split(r"[ .\-]+", phrase))


@lru_cache(maxsize=256)
def noisy_pattern(phrase: str) -> str:
    """Return a pattern of a phrase under the noise of a scan."""
    parts = []
    for token in _SYNTAX.findall(phrase):
        if token in ("(?:", "(", ")", "?", "|"):
            parts.append(token)
        elif token.isalnum():
            parts.append(_LIKE.get(token, re.escape(token)) + _BETWEEN)
        else:
            parts.append(r"[\W_]*")
    return "".join(parts)


@lru_cache(maxsize=256)
def plain(phrase: str) -> str:
    """Return how a phrase reads: of a group the first choice, what may be missing left out."""
    phrase = re.sub(r"\(\?:[^()]*\)\?", "", phrase)
    while "(" in phrase:
        phrase = re.sub(r"\(\?:([^()|]*)(?:\|[^()]*)?\)", r"\1", phrase)
    return phrase


@lru_cache(maxsize=256)
def required(phrase: str) -> str:
    """Return letters, in their canonical form, that a text must have to be the phrase under any noise."""
    while "(" in phrase:
        phrase = re.sub(r"\(\?:[^()]*\)\??", " ", phrase)
    return canonical(max(phrase.split(), key=len)[:_LEAST])


def any_of(letters: Iterable[str]) -> Callable[[str], object]:
    """Return what tells whether a canonical form has some of several letters: in one look, as lines are many."""
    return re.compile("|".join(map(re.escape, set(letters)))).search


def respelt(line: int, printed: str, read: str) -> Iterator[Repair]:
    """Yield the repairs that make a text another one, one of each kind; upper case is no noise."""
    printed = printed.strip()
    if printed.casefold() == read.casefold():
        return
    bare, goal = (re.sub(r"[\W_]", "", text.replace("|", "1").replace("!", "1")) for text in (printed, read))
    changed = {(a, b) for a, b in zip(bare, goal, strict=False) if a.casefold() != b.casefold()}
    if any({a, b} & set("0oO") for a, b in changed):
        yield Repair(line, RepairKind.ZERO, printed, read)
    if any({a, b} & set("1lIi") for a, b in changed) or ({"|", "!"} & set(printed)) - set(read):
        yield Repair(line, RepairKind.ONE, printed, read)
    marks, wanted = (re.findall(r"[^\w\s]|_", text) for text in (printed, read))
    if set(marks) - {"|", "!"} and len(marks) > len(wanted):
        yield Repair(line, RepairKind.STRAY, printed, read)
    elif not changed and not ({"|", "!"} & set(printed)):
        yield Repair(line, RepairKind.SPLIT, printed, read)
