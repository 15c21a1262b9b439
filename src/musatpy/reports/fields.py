"""The record, said once: every field with its kind, unit, meaning and values; JSON and its schema are made from it.

The values of a field are those of the attribute by its name, where it does not say another, or a function.

A kind is that of one value: `string`, `integer`, `number`, `boolean`, with `?` where it may be null. Sizes before
it make lists of it: `3 number?`, `6x6 number`, `* string` of any length. ` or null` makes the whole null where
there is none. `const` has one choice; `enum` is any of the choices, and says no more; `map` has whole numbers by
names.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property, partial
from operator import attrgetter
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np

from musatpy.reports.editing import Headings, field_width, printed_unit, recorded_unit, with_decimals
from musatpy.reports.values import Json, LazyColumn, Values, number, plain, rounded, unnested

Schema = dict[str, Any]
Source = TypeVar("Source")
Item = TypeVar("Item")
Part = TypeVar("Part")

DIGITS = 12  # of numbers in tables that are neither coordinates nor angles nor covariances
IMAGE_DIGITS = 10  # of the tests of images, of which there are many
ENU = "east north up"  # axes of sigmas and differences
_NULL = " or null"
_STEP = re.compile(r"\[(\d+)\]")
_EXACT_UNIT = re.compile(r"rad|m2")


def same(source: Any) -> Any:
    """Return the source itself: of a table, or of an object, with the fields of what it stands in."""
    return source


@dataclass(frozen=True, eq=False)
class Node(Generic[Source]):
    """A name in the record with what stands there."""

    name: str
    inside: ClassVar[Node[Any] | None] = None  # the object that it is in; None: the record itself

    @property
    def place(self) -> str:
        """Its path in the record."""
        return f"{self.inside.place}.{self.name}" if self.inside else self.name

    def schema(self) -> Schema:
        """Return what the schema says of it."""
        raise NotImplementedError

    def json(self, source: Source) -> Json:
        """Return what stands there."""
        raise NotImplementedError

    def held(self, source: Source) -> Json:
        """Return what stands there, the columns of tables as `LazyColumn`."""
        return self.json(source)


@dataclass(frozen=True, eq=False)
class Field(Node[Source]):
    """One field: of an object its value, of a table its values, one per row (an array, or a list as it is).

    Where it is printed it has a heading and an edit descriptor; of a vector one for each component, or one for all.
    What is printed and not recorded has no kind. Its unit is that of its heading, where it does not say another.
    """

    kind: str = ""
    text: str = ""  # what it means
    values: Callable[[Source], Any] | str = ""  # or the path of the attribute; empty: that by its name
    heading: str | Sequence[str] | Headings = ""  # one or two lines, parted by a line feed
    edit: str | Sequence[str] = ""  # edit descriptor (see `musatpy.reports.editing`)
    unit: str = ""
    choices: Iterable[Any] = ()
    exact: bool = False  # of numbers in tables: at full precision whatever the unit, as coordinates are
    seldom: bool = False  # stands in the record only where it says something
    significant: int = DIGITS  # digits of its numbers in a table, where it does not have all of them
    is_id: bool = False  # names what the row is about
    words: Mapping[Any, str] = dataclasses.field(default_factory=dict)  # what it says -> what is printed
    shown: Callable[[Values], Any] | None = None  # what is printed of a table in its stead, in units of the record
    blank: bool = False  # may be left blank in print whatever the value is
    of_run: bool = False  # printed of what no record has
    card_width: int = 0  # columns of a number on its card, with whose decimals it is printed
    when: Callable[[Values], bool] | None = None  # in a table where it is printed; None: in all

    def __post_init__(self) -> None:
        if self.kind and not self.unit:
            object.__setattr__(self, "unit", recorded_unit(self.heading))

    @property
    def digits(self) -> int | None:
        """Significant digits of its numbers in a table; None: all of them, as of angles and of covariances."""
        is_number = self.kind.removesuffix(_NULL).rpartition(" ")[2].removesuffix("?") == "number"
        return None if self.exact or not is_number or _EXACT_UNIT.search(self.unit) else self.significant

    def of(self, source: Source) -> Any:
        """Return its value, or of a table its values."""
        return attrgetter(self.values or self.name)(source) if isinstance(self.values, str) else self.values(source)

    @cached_property
    def width(self) -> int:
        """Columns of print: as many as the descriptor or the longer heading line needs."""
        return max(field_width(str(self.edit)), *(len(line) for line in str(self.heading).split("\n")))

    def columns(self, system: str = "") -> Iterator[Field[Source]]:
        """Yield what is printed of it side by side in a job of a coordinate system: of a vector its components."""
        heading, edit = self.heading, self.edit
        if isinstance(heading, Headings):
            heading, edit = heading.of(system)
        if isinstance(heading, str):
            yield self
            return
        edits = (edit,) * len(heading) if isinstance(edit, str) else edit
        wide = int(self.kind[2]) if self.kind[1:2] == "x" else len(heading)
        for n, (words, descriptor) in enumerate(zip(heading, edits, strict=True)):
            step = f"[{n // wide}][{n % wide}]" if wide < len(heading) else f"[{n}]"  # of a matrix, or a vector
            shown = None if self.shown is None else partial(self._component, n)
            yield replace(self, name=f"{self.name}{step}", heading=words, edit=descriptor, shown=shown)

    def _component(self, number: int, table: Values) -> Any:
        assert self.shown is not None
        return self.shown(table)[:, number]

    def exactly(self, table: Values) -> Any:
        """Return what is printed of a table in units of the record: an array, or a list of texts."""
        values = table[self.name] if self.shown is None else self.shown(table)
        if self.words:
            listed = values.tolist() if isinstance(values, np.ndarray) else values
            return [self.words.get(value, value) for value in listed]
        if isinstance(values, np.ndarray) and values.dtype != object:
            return values
        return ["" if value is None else value for value in values]

    def printed(self, table: Values) -> Any:
        """Return what is printed of a table in its printed unit."""
        values, unit = self.exactly(table), printed_unit(str(self.heading))
        return values if unit == 1.0 else np.asarray(values, dtype=float) / unit

    def fitted(self, table: Values, spare: int) -> Field[Source]:
        """Return the column with as many decimals as its values need, of a number that a card has."""
        if not self.card_width:
            return self
        return replace(self, edit=with_decimals(str(self.edit), self.printed(table), self.card_width, spare))

    def schema(self) -> Schema:
        unit = {"unit": self.unit} if self.unit else {}
        return {**_schema(self.kind, self.choices), **unit, "description": self.text}

    def json(self, source: Source) -> Json:
        value = self.of(source)
        if isinstance(value, int) and self.kind == "number?":
            return number(value)
        return _plain(value)


class Tabled(Node[Source], Generic[Source, Item]):
    """What has columns: the fields of a table, or of an object, which is one row."""

    fields: Sequence[Node[Item]]

    @property
    def printed(self) -> list[Field[Item]]:
        """The fields that are printed where nothing else is said."""
        return [field for field in self.fields if isinstance(field, Field) and (field.heading or field.edit)]

    def column(self, path: str, heading: Any = "", edit: Any = "", **changes: Any) -> Field[Any]:
        """Return a column, or a component of one (`xy[1]`), as it is said once, or printed in another way."""
        known = {field.name: field for field in self.fields if isinstance(field, Field)}
        said, steps = known[path.partition("[")[0]], len(_STEP.findall(path))
        if heading or edit:
            changes |= {"heading": heading, "edit": edit}
        if steps:
            sizes, _, base = said.kind.rpartition(" ")
            left = "x".join(sizes.split("x")[steps:])
            changes |= {"name": path, "kind": f"{left} {base}".strip(), "shown": None}
        return replace(said, **changes)

    def items(self, source: Source) -> Iterable[Item]:
        """Return what its rows are of, one for each."""
        raise NotImplementedError

    def raw(self, source: Source, nested: str = "") -> Mapping[str, Any]:
        """Return its columns by name, one entry per row, those of a `nested` table too."""
        items = list(self.items(source))
        fields = [field for field in self.fields if isinstance(field, Field) and field.kind]
        outer = {field.name: [field.of(item) for item in items] for field in fields}
        if not nested:
            return outer
        part: Any = next(field for field in self.fields if field.name == nested)
        return unnested(outer, [part.raw(item) for item in items], nested)


@dataclass(frozen=True, eq=False)
class FieldGroup(Tabled[Source, Item]):
    """An object with fields; null, where it may be, as its source is None."""

    text: str
    fields: Sequence[Node[Item]]
    of: Callable[[Source], Item | None] = same
    optional: bool = False
    shared: str = ""  # name of its definition in the schema, where several are alike

    def __post_init__(self) -> None:
        for field in self.fields:
            object.__setattr__(field, "inside", self)

    def schema(self) -> Schema:
        if self.shared:
            return {**({"description": self.text} if self.text else {}), "$ref": f"#/$defs/{self.shared}"}
        return self.definition()

    def definition(self) -> Schema:
        """Return what the schema says of it, shared or not."""
        kind = ["object", "null"] if self.optional else "object"
        return {"type": kind, "description": self.text, **properties_of(self.fields)}

    def json(self, source: Source) -> Json:
        item = self.of(source)
        return None if item is None else {field.name: field.json(item) for field in self.fields}

    def held(self, source: Source) -> Json:
        item = self.of(source)
        return None if item is None else {field.name: field.held(item) for field in self.fields}

    def items(self, source: Source) -> Iterable[Item]:
        item = self.of(source)
        return [] if item is None else [item]


@dataclass(frozen=True, eq=False)
class Rows(Tabled[Source, Item]):
    """A table of columns, each a list with one entry per row; without rows as its source is None."""

    text: str
    fields: Sequence[Field[Item]]
    of: Callable[[Source], Item | None] = same
    of_images: bool = False  # rows are images, or one of their coordinates: may be left out of a record

    def schema(self) -> Schema:
        fields = properties_of(self.fields)
        for field in self.recorded:
            items = fields["properties"][field.name]
            about = {key: items.pop(key) for key in ("unit", "description") if key in items}
            digits = {} if field.digits is None else {"digits": field.digits}
            fields["properties"][field.name] = {"type": "array", "items": items, **about, **digits}
        return {"type": "object", "description": self.text, "columns": True, **fields}

    def json(self, source: Source) -> Json:
        columns = ((field.name, rounded(values, field.digits)) for field, values in self.columns(source))
        return {name: plain(values) if isinstance(values, np.ndarray) else list(values) for name, values in columns}

    def held(self, source: Source) -> Json:
        item = self.of(source)
        if item is None:
            return self.json(source)
        return {field.name: LazyColumn(partial(field.of, item), field.digits) for field in self.recorded}

    def raw(self, source: Source, nested: str = "") -> Mapping[str, Any]:
        item, fields = self.of(source), {field.name: field for field in self.recorded}
        return Values(list(fields), lambda name: [] if item is None else fields[name].of(item))

    def columns(self, source: Source) -> Iterator[tuple[Field[Item], Any]]:
        """Yield the fields with their values, one per row, as arrays or lists."""
        item = self.of(source)
        for field in self.recorded:
            yield field, [] if item is None else field.of(item)

    @property
    def recorded(self) -> list[Field[Item]]:
        """The fields that stand in the record."""
        return [field for field in self.fields if field.kind]


@dataclass(frozen=True, eq=False)
class Each(Tabled[Source, Item]):
    """A table with a row for each of some things, which have the values of the fields."""

    text: str
    fields: Sequence[Node[Item]]
    of: Callable[[Source], Iterable[Item]] = same
    shared: str = ""
    length: int | None = None  # the number of rows, where it is always the same

    def schema(self) -> Schema:
        if self.shared:
            return {"description": self.text, "$ref": f"#/$defs/{self.shared}"}
        return {"type": "array", "description": self.text, **self._items()}

    def definition(self) -> Schema:
        """Return what the schema says of it where several are alike."""
        return {"type": "array", **self._items()}

    def _items(self) -> Schema:
        limits = {} if self.length is None else {"minItems": self.length, "maxItems": self.length}
        return {**limits, "items": {"type": "object", **properties_of(self.fields)}}

    def json(self, source: Source) -> Json:
        return [{field.name: field.json(item) for field in recorded(self.fields)} for item in self.of(source)]

    def items(self, source: Source) -> Iterable[Item]:
        return self.of(source)


def within(part: Callable[[Source], Part], fields: Iterable[Field[Part]]) -> list[Field[Source]]:
    """Return the fields of a part of a source as fields of the source."""

    def values(field: Field[Part], source: Source) -> Any:
        return field.of(part(source))

    return [replace(field, values=partial(values, field)) for field in fields]  # type: ignore[misc]


def identity(name: str, values: Callable[[Any], Any] | str = "", text: str = "") -> Field[Any]:
    """Return the field of the ids of a row: of photos, points, models."""
    text = text or f"{name} id"
    return Field(name, "string", text, values, heading=name.capitalize(), edit="A8", is_id=True)


def flag(name: str, text: str, heading: str, mark: str, values: Callable[[Any], Any] | str = "") -> Field[Any]:
    """Return a field that is true or not, and printed as a mark where it is."""
    words = {True: mark, False: ""}
    return Field(name, "boolean", text, values, heading=heading, edit=f"A{len(mark)}", words=words)


def unrecorded(heading: str, edit: str, values: Callable[[Any], Any], *, is_id: bool = False) -> Field[Any]:
    """Return a column of what no record has: `values` of the source of the table, in units that records have."""
    return Field(heading, heading=heading, edit=edit, shown=values, is_id=is_id)


def of_job(heading: str, edit: str, values: Callable[[Any], Any]) -> Field[Any]:
    """Return a column of what no table of the record has: `values` of the statistics of a job."""
    return Field(heading, heading=heading, edit=edit, shown=lambda t: values(getattr(t, "source", t)), of_run=True)


def without_images(nodes: Iterable[Node[Part]]) -> Iterator[Node[Part]]:
    """Yield fields and tables, but no table of images, nor the parts of objects that are one."""
    for node in nodes:
        if isinstance(node, FieldGroup):
            yield replace(node, fields=tuple(without_images(node.fields)))
        elif not _is_of_images(node):
            yield node


def _is_of_images(node: Node[Any]) -> bool:
    return isinstance(node, Rows) and node.of_images


def is_seldom(node: Node[Any]) -> bool:
    """Tell whether a field may not be there."""
    return isinstance(node, Field) and node.seldom


def recorded(nodes: Iterable[Node[Part]]) -> list[Node[Part]]:
    """Return what stands in the record: not what is printed only."""
    return [node for node in nodes if not isinstance(node, Field) or node.kind]


def properties_of(fields: Iterable[Node[Any]]) -> Schema:
    """Return what the schema says of an object with these fields, and of these alone."""
    fields = recorded(fields)
    properties = {field.name: field.schema() for field in fields}
    required = [field.name for field in fields if not (_is_of_images(field) or is_seldom(field))]
    return {"additionalProperties": False, "required": required, "properties": properties}


@dataclass(frozen=True, kw_only=True, eq=False)
class Document(Generic[Source]):
    """The record of a program: the version of its schema, and what it has."""

    name: str  # of the field with the version
    version: str
    title: str
    about: str
    nodes: Sequence[Node[Any]]
    about_version: str = "of this schema"
    definitions: Sequence[Any] = ()  # of nodes that are `shared`

    @property
    def whole(self) -> tuple[Node[Any], ...]:
        """The version, and all fields and tables."""
        version: Field[Any] = Field(
            self.name, "const", self.about_version, lambda _: self.version, choices=(self.version,)
        )
        return (version, *self.nodes)

    def present(self, source: Source) -> list[Node[Any]]:
        """Return what stands in the record: without fields that are seldom there and have nothing to say."""
        return [node for node in self.whole if not is_seldom(node) or node.json(source)]

    def record(self, source: Source, **others: Any) -> dict[str, Json]:
        """Return the record of a source; `others` are those of the nodes by name that have their own."""
        return {node.name: node.json(others.get(node.name, source)) for node in self.present(source)}

    def schema(self) -> Schema:
        """Return the JSON Schema of the record."""
        definitions = {node.shared or node.name: node.definition() for node in self.definitions}
        return {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": self.title,
            "description": self.about,
            "type": "object",
            **properties_of(self.whole),
            **({"$defs": definitions} if definitions else {}),
        }


def _schema(kind: str, choices: Iterable[Any]) -> Schema:
    if kind == "const":
        return {"const": next(iter(choices))}
    if kind == "enum":
        return {"enum": list(choices)}
    if kind == "map":
        return {"type": "object", "additionalProperties": {"type": "integer"}}
    if kind.endswith(_NULL):
        whole = _schema(kind.removesuffix(_NULL), choices)
        return {**whole, "type": [whole["type"], "null"]}
    sizes, _, base = kind.rpartition(" ")
    name = base.removesuffix("?")
    schema: Schema = {"type": name if base == name else [name, "null"]}
    if choices:
        schema["enum"] = [*choices] if base == name else [*choices, None]
    for size in reversed(sizes.split("x") if sizes else []):
        limits = {} if size == "*" else {"minItems": int(size), "maxItems": int(size)}
        schema = {"type": "array", **limits, "items": schema}
    return schema


def _plain(value: Any) -> Json:
    if isinstance(value, float):
        return number(value)
    if isinstance(value, np.ndarray):
        return plain(value)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return value
