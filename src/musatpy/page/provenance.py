"""What a page was made of: program, schema, and the hashes of files."""

from __future__ import annotations

from collections.abc import Mapping

import musatpy
from musatpy.page.parts import Chapter, Fact, Facts
from musatpy.plots.tables import Tables, part

_SCHEMAS = ("schema_version", "compilation_version", "soundings_version")


def provenance(tables: Tables, files: Mapping[str, str]) -> Chapter:
    """Return the chapter that says what a page was made of; `files` are names with the SHA-256 of each."""
    program = part(tables, "program")
    schema = next((str(tables[name]) for name in _SCHEMAS if name in tables), "")
    facts = [
        Fact(label="Program of the record", value=f"musatpy {program['version']}" if program else ""),
        Fact(label="Kernels", value=str(program.get("kernels") or "")),
        Fact(label="Schema of the record", value=schema),
        Fact(label="Program of the page", value=f"musatpy {musatpy.__version__}"),
        *(Fact(label=f"SHA-256 of {name}", value=digest) for name, digest in files.items()),
    ]
    parts = [Facts(facts=[fact for fact in facts if fact.value])]
    return Chapter(title="Files And Program", anchor="files-and-program", parts=parts)


def closing() -> str:
    """Return the last line of a page."""
    return (
        f"Made by musatpy {musatpy.__version__} from the record, which has more digits and every row. Blank cells "
        "are numbers that do not exist."
    )
