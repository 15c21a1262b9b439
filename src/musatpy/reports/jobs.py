"""What was merged and extracted, as text."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from musatpy.jobs.agreement import Part
from musatpy.jobs.extract import Extract
from musatpy.jobs.merge import Merged
from musatpy.jobs.naming import Kind, Names
from musatpy.reports.pages import PAGE_WIDTH, wrapped

_INDENT = "    "


def merge_text(parts: Sequence[Part], names: Sequence[Names], merged: Merged) -> str:
    """Return what was merged: the parts with their new `names`, what they have in common, and what to note."""
    lines = []
    for part, new in zip(parts, names, strict=True):
        block = part.block
        lines.append(
            f"{part.name}: {len(block.photos.ids)} photos, {len(block.points.ids)} points, "
            f"{len(block.plates.photo)} measurements, {len(block.control.point)} control points"
        )
        for kind, changes in new.items():
            if changes:
                lines += named(f"  {kind}s renamed", [f"{old} > {name}" for old, name in changes.items()])
    for kind, shared in merged.shared.items():
        if kind in (Kind.TIDE, Kind.DAY):
            continue  # a note, where it means anything
        lines += named(f"{kind}s in several decks, each one {kind}", [name for name, _ in shared])
    for what, count in merged.once.items():
        lines.append(f"given alike in several decks, and kept once: {what}: {count}")
    if merged.believed:
        lines += named("given differently, and held as the preferred deck says", merged.believed)
    return _text([*lines, *wrapped(merged.notes, lead="note: ")])


def extract_text(extract: Extract) -> str:
    """Return what an extract has not, and what to note."""
    lines = []
    for kind, names in extract.left_out.items():
        lines += named(f"{kind} left out", names)
    if extract.single:
        lines += named("points left with one ray, and nothing known of them", extract.single)
    if extract.dropped:
        lines += named("points dropped with their only ray", extract.dropped)
    return _text([*lines, *wrapped(extract.notes, lead="note: ")])


def named(label: str, names: Sequence[str]) -> list[str]:
    """Return a label with the number of names, and the names below it."""
    return [f"{label}: {len(names)}", *listed(names)]


def listed(names: Iterable[str]) -> list[str]:
    """Return names two blanks apart on indented lines of the width of the paper; a name is never broken."""
    lines: list[str] = []
    line = ""
    for name in names:
        if line and len(_INDENT) + len(line) + 2 + len(name) > PAGE_WIDTH:
            lines.append(_INDENT + line)
            line = ""
        line += f"  {name}" if line else name
    return [*lines, _INDENT + line] if line else lines


def _text(lines: Iterable[str]) -> str:
    return "".join(f"{line}\n" for line in lines)
