"""What the program is that makes results: its version, and a hash of its sources and card formats."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import musatpy
from musatpy.formats.cards.spec import card_formats_folder

_SOURCES = (".py", ".toml")


@cache
def sources_sha256() -> str:
    """Return a hash of the sources of the package and of its own card formats, the same wherever it is installed.

    A checkout has the version of its release for months: the version alone does not say what program it is.
    """
    package, formats = Path(musatpy.__file__).resolve().parent, card_formats_folder()
    files = {
        (root.name, path.relative_to(root).as_posix()): path
        for root in (package, formats)
        for path in root.rglob("*")
        if path.suffix in _SOURCES
    }
    digest = hashlib.sha256()
    for (root, name), path in sorted(files.items()):
        if root == package.name and name.startswith(("card_formats/", "examples/examples.")):
            continue  # those of a wheel, which stand elsewhere in a checkout
        content = path.read_bytes().replace(b"\r\n", b"\n")
        digest.update(f"{root}/{name} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def program() -> str:
    """Return the version of the program and what its sources are, in a word."""
    return f"{musatpy.__version__} ({sources_sha256()[:12]})"
