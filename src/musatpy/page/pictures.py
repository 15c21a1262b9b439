"""The pictures of a record as a chapter."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Sequence
from typing import Any

from musatpy.page.parts import Chapter, PagePicture
from musatpy.page.stated import anchor_of
from musatpy.plots.gallery import file_of
from musatpy.plots.picture import Picture
from musatpy.plots.tables import SharedTables, Tables

# What a data URI within double quotes of HTML has to escape, in this order; quotes of SVG become single ones.
_ESCAPES = {"'": "&apos;", "%": "%25", "#": "%23", "<": "%3C", ">": "%3E", "&": "%26", '"': "'"}
_INDENT = re.compile(r"\s*\n\s*")
_PROLOG = re.compile(r"^.*?(?=<svg)", re.DOTALL)


def pictures_chapter(pictures: Sequence[Picture[Any]], tables: Tables) -> Chapter:
    """Return the chapter of the pictures that a record has something to show in."""
    return Chapter(title="Pictures", anchor="pictures", parts=list(_shown(pictures, SharedTables(tables))))


def _shown(pictures: Sequence[Picture[Any]], tables: Tables) -> Iterator[PagePicture]:
    for picture in pictures:
        drawn = picture.drawn(tables)
        if drawn is None:
            continue
        figure, sentence = drawn
        yield PagePicture(
            title=picture.title,
            anchor=anchor_of(f"picture {picture.name}"),
            sentence=sentence,
            uri=_uri(*file_of(figure, picture.name)),
        )


def _uri(suffix: str, data: bytes) -> str:
    """Return a picture as a data URI. SVG stays text: in base 64 it would be longer by a third."""
    if suffix == "svg":
        text = _INDENT.sub(" ", _PROLOG.sub("", data.decode("utf-8"))).replace("> <", "><")
        for character, escape in _ESCAPES.items():
            text = text.replace(character, escape)
        return f"data:image/svg+xml,{text}"
    return f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"
