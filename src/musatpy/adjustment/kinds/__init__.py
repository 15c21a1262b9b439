"""The kinds of observations and of global unknowns, a few to a file; whoever deals with all loops over these.

Every file of this folder with `KINDS` counts, in the order of `model.ObservationKind`.
"""

from importlib import import_module
from pathlib import Path

from musatpy.adjustment.kinds.kind import Kind, OfWater, Rows, Unknown
from musatpy.adjustment.kinds.known import Prior
from musatpy.adjustment.kinds.measured import MeasuredKind, kept_axes


def _all() -> list[Kind]:
    """Return the kinds of all files of the folder."""
    names = [path.stem for path in Path(__file__).parent.glob("*.py") if path.stem != "__init__"]
    kinds = (kind for name in names for kind in getattr(import_module(f"{__name__}.{name}"), "KINDS", ()))
    return sorted(kinds, key=lambda kind: kind.observed)


KINDS = tuple(_all())
DIRECT = tuple(kind for kind in KINDS if kind.direct)
MEASURED = tuple(kind for kind in KINDS if isinstance(kind, MeasuredKind))
PRIORS = tuple(kind for kind in KINDS if isinstance(kind, Prior))
UNKNOWNS = tuple(kind for kind in KINDS if isinstance(kind, Unknown))
WATER = tuple(kind for kind in KINDS if isinstance(kind, OfWater))
SEARCHED = tuple(kind for kind in KINDS if kind.searched)

__all__ = ["DIRECT", "KINDS", "MEASURED", "PRIORS", "SEARCHED", "UNKNOWNS", "WATER", "Kind", "Rows", "kept_axes"]
