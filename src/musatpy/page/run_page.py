"""The page of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from musatpy.page.parts import Page
from musatpy.page.pictures import pictures_chapter
from musatpy.page.provenance import closing, provenance
from musatpy.page.run_chapters import chapters_of
from musatpy.page.stated import in_columns
from musatpy.page.summary import top_of
from musatpy.plots.gallery import GALLERY
from musatpy.plots.tables import Tables

_PICTURES_BEHIND = "Accuracy"


def run_page(tables: Tables, files: Mapping[str, str]) -> Page:
    """Return the page of the record of a run; `files` are names with the SHA-256 of each, the record first."""
    pictures, tables = pictures_chapter(GALLERY, tables), in_columns(tables)
    chapters = []
    for chapter in chapters_of(tables):
        chapters += [chapter, pictures] if chapter.title == _PICTURES_BEHIND else [chapter]
    chapters = [chapter for chapter in chapters if chapter.parts]
    page = top_of(tables, [*chapters, provenance(tables, files)])
    return replace(page, closing=closing())
