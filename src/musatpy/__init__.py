"""Two-media aerotriangulation from card decks: MUSAT-IIA again, and better."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from musatpy import plots
    from musatpy.formats.builder import BlockBuilder
    from musatpy.formats.musat import read_deck, write_deck
    from musatpy.model import Block, Solution
    from musatpy.notebook.frames import to_pandas, to_xarray
    from musatpy.notebook.html import to_html
    from musatpy.pipeline import adjust
    from musatpy.reports.listing import listing
    from musatpy.statistics.verdict import verdict

__version__ = "0.1.0"

__all__ = [
    "Block",
    "BlockBuilder",
    "Solution",
    "adjust",
    "extend",
    "listing",
    "plots",
    "read_deck",
    "to_html",
    "to_pandas",
    "to_xarray",
    "verdict",
    "write_deck",
]

# Imported when first asked for, so that `musat --help` and `musat check` do not load the adjustment.
_MODULES = {
    "Block": "musatpy.model",
    "BlockBuilder": "musatpy.formats.builder",
    "Solution": "musatpy.model",
    "adjust": "musatpy.pipeline",
    "listing": "musatpy.reports.listing",
    "read_deck": "musatpy.formats.musat",
    "to_html": "musatpy.notebook.html",
    "to_pandas": "musatpy.notebook.frames",
    "to_xarray": "musatpy.notebook.frames",
    "verdict": "musatpy.statistics.verdict",
    "write_deck": "musatpy.formats.musat",
}


def extend(*modules: str) -> None:
    """Add the kinds of observations that modules state, by their names, as MUSATPY_EXTENSIONS does for commands.

    Raises `MusatError` for a module that cannot be imported or states none, and where the model is there already.
    """
    from musatpy.errors import MusatError

    if "musatpy.model" in sys.modules:
        raise MusatError(f"{', '.join(modules)}: call extend before anything else of musatpy is used")
    os.environ["MUSATPY_EXTENSIONS"] = ",".join([*os.environ.get("MUSATPY_EXTENSIONS", "").split(","), *modules])
    import_module("musatpy.model")


def __getattr__(name: str) -> Any:
    if name == "plots":
        return import_module("musatpy.plots")
    if name not in _MODULES:
        raise AttributeError(f"module 'musatpy' has no attribute '{name}'")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
