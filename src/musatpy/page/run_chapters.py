"""The chapters of the page of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from musatpy.page import flight, stated_answer
from musatpy.page.accuracy import depths_of, refraction_sentences, samples
from musatpy.page.analysis_tables import analysis_table, orders_table, sample_table
from musatpy.page.cells import significant
from musatpy.page.parts import Chapter, Fact, Facts, Head, PageTable, Part, Texts
from musatpy.page.run_tables import (
    ACCURACY,
    CAMERA,
    COMPUTED,
    CONTROL,
    LEFT_OUT,
    OBSERVATIONS,
    OPTION_WORDS,
    PHOTOS,
    RESULTS,
    TIDES,
    WATER,
)
from musatpy.page.stated import anchor_of, tables_of
from musatpy.plots.tables import Tables, part, texts
from musatpy.reports import adjusted_water, analyses, job_record, solution_summary, titles
from musatpy.reports.fields import Field, same

_WARNINGS = 50
_BY_KIND = ("Observations, ", "Unknowns, ", "Sigma0, ")  # labels of numbers that are told beside others
_HELD = (
    "Cameras are taken as calibrated: focal length, principal point and distortion are no unknowns of the "
    "adjustment, and without error; what is wrong in them is in the residuals."
)


def chapters_of(tables: Tables) -> list[Chapter]:
    """Return the chapters of a run but those of pictures, whose place is behind the accuracy, and of the record."""
    contents = [
        ("Data", _data(tables)),
        ("What Was Left Out", _left_out(tables)),
        ("Accuracy", _accuracy(tables)),
        ("Camera And Water", _camera(tables)),
        ("Worst Observations And Blunders", _worst(tables)),
        ("Stations And Points", _results(tables)),
        ("How It Was Computed", _computed(tables)),
    ]
    chapters = [Chapter(title=title, anchor=anchor_of(title), parts=list(parts)) for title, parts in contents]
    return [chapter for chapter in chapters if chapter.parts]


def _data(tables: Tables) -> Iterator[Part]:
    sizes = _known(titles.SIZE.numbers(tables))
    counts = [Fact(label=label, value=f"{values[0]:,}") for label, values in sizes.items() if values[0]]
    yield Facts(facts=[*counts, *flight.flight_facts(tables), *flight.times_fact(tables)])
    summary = _known(solution_summary.SUMMARY.numbers(tables))
    observed = part(tables, "solution.observations")
    kinds = ", ".join(f"{kind} {count:,}" for kind, count in observed.items() if count)
    unknown = part(tables, "solution.unknowns")
    unknowns = ", ".join(f"{kind} {count:,}" for kind, count in unknown.items() if count)
    details = {"Observations, all": kinds, "Unknowns, all": unknowns}
    yield Facts(
        facts=[
            Fact(label=label, value=_plain(values[0]), detail=details.get(label, ""))
            for label, values in summary.items()
            if not label.startswith(_BY_KIND) or label.endswith(", all")
        ]
    )
    rays = flight.rays_table(tables)
    if rays is not None:
        yield rays
    yield from tables_of(TIDES, tables)


def _known(labels: Mapping[str, Sequence[float | None]]) -> dict[str, list[float]]:
    """Return labels with the numbers that a record has of them."""
    known = {label: [value for value in values if value is not None] for label, values in labels.items()}
    return {label: values for label, values in known.items() if values}


def _plain(value: Any) -> str:
    return f"{value:,}" if isinstance(value, int) else significant(value)


def _left_out(tables: Tables) -> Iterator[Part]:
    points, plates = part(tables, "points"), part(tables, "plates")
    status = texts(points, "status")
    untied = len(plates.get("triangulated", ())) - sum(plates.get("triangulated", ()))
    facts = []
    for name, label in (
        ("intersected", "Points intersected, not triangulated"),
        ("not_determined", "Points without a position"),
    ):
        if count := int((status == name).sum()):
            facts.append(Fact(label=label, value=f"{count:,}", detail=f"of {len(status):,}"))
    if untied:
        facts.append(
            Fact(
                label="Images kept out of the solution", value=f"{untied:,}", detail=f"of {len(plates['photo']):,}"
            )
        )
    if facts:
        yield Facts(facts=facts)
    yield from tables_of(LEFT_OUT, tables)
    if unedited := tables.get("unedited"):
        yield Texts(texts=[f"EDIT has edited nothing: {unedited}."])
    warnings = part(tables, "solution").get("warnings", ())
    if warnings:
        yield Texts(texts=list(warnings[:_WARNINGS]), title="Warnings", anchor="warnings", listed=True)
        if len(warnings) > _WARNINGS:
            yield Texts(texts=[f"And {len(warnings) - _WARNINGS:,} more: the record has all."])
    if not (facts or warnings or unedited or part(tables, "findings").get("action")):
        yield Texts(texts=["Nothing: every image took part, and every point has a position."])


def _accuracy(tables: Tables) -> Iterator[Part]:
    every, depths = samples(tables), depths_of(tables)
    if every:
        yield sample_table(every)
    else:
        yield Texts(texts=["No control point or check point says how far positions are from given ones."])
    yield from tables_of(CONTROL, tables)
    sentences = list(refraction_sentences(tables, depths))
    if sentences:
        yield Texts(texts=sentences, title="What Refraction Changed", anchor="what-refraction-changed")
    orders = orders_table(depths)
    if orders is not None:
        yield orders
    yield from tables_of(ACCURACY, tables)


def _camera(tables: Tables) -> Iterator[Part]:
    yield from tables_of(CAMERA, tables)
    yield Texts(texts=[_HELD])
    water = part(tables, "adjusted_water")
    if water:
        yield Facts(facts=_water_facts(tables))
        exact = water.get("without_error") or ()
        if exact:
            yield Texts(texts=[f"Taken to be without error, as the cards give no sigma: {'; '.join(exact)}."])
    yield from tables_of(WATER, tables)


def _water_facts(tables: Tables) -> list[Fact]:
    facts, undetermined = [], " ".join(tables["adjusted_water"].get("undetermined") or ())
    for label, values in _known(adjusted_water.SURFACE.numbers(tables)).items():
        if label.split()[0].lower() in undetermined:  # tilt, refractive
            facts.append(Fact(label=label, value="not determined", detail=""))
            continue
        unit = "" if label == "Refractive index" else " ″"
        sigma = f"sigma {significant(values[1])}{unit}" if len(values) > 1 else "known"
        facts.append(Fact(label=label, value=f"{significant(values[0])}{unit}", detail=sigma))
    return facts


def _worst(tables: Tables) -> Iterator[Part]:
    shown = [*tables_of(OBSERVATIONS, tables)]
    yield from shown
    if not shown:
        yield Texts(texts=["The solution carries no statistics of its observations."])


def _results(tables: Tables) -> Iterator[Part]:
    yield from stated_answer.stated_tables(tables, PHOTOS)
    yield from tables_of(RESULTS, tables)


def _computed(tables: Tables) -> Iterator[Part]:
    if settings := tables.get("settings"):
        yield Texts(texts=[f"Set for this run: {', '.join(settings)}."])
    yield _options(tables)
    for layout in analyses.LAYOUTS:
        table = analysis_table(tables, f"analyses.{layout.table}", layout.title, layout.row)
        if table is not None:
            yield table
    yield from tables_of(COMPUTED, tables)


def _options(tables: Tables) -> PageTable:
    """Return the options of the run, as the record describes them."""
    values = part(tables, "options")
    stated = job_record.part("options", "options", same).fields
    fields = [field for field in stated if isinstance(field, Field) and field.name in values]
    title = "Options"
    return PageTable(
        title=title,
        anchor=anchor_of(title),
        heads=[
            Head(text="Option", is_id=True, is_text=True),
            Head(text="Value", is_text=True),
            Head(text="Meaning", is_text=True),
        ],
        rows=[
            [
                field.name.replace("_", " "),
                _option(values[field.name], field.unit),
                _words(field.name, values) or field.text,
            ]
            for field in fields
        ],
        total=len(fields),
        folded=True,
    )


def _option(value: Any, unit: str) -> str:
    text = significant(value) if isinstance(value, float) else str(value)
    return f"{text} {unit}".rstrip()


def _words(name: str, values: Any) -> str:
    return str(OPTION_WORDS.get(name, {}).get(values[name], ""))
