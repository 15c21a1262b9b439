"""A figure of matplotlib, and how it becomes the bytes of a PNG file, or a page of PDF."""

from __future__ import annotations

from io import BytesIO
from typing import Any

from musatpy.errors import MusatError


def new_figure(width: float, height: float) -> Any:
    """Return an empty figure of the given size (inches). Raises `MusatError` where matplotlib is missing."""
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MusatError("pictures need matplotlib: pip install 'musatpy[plots]'") from error
    return Figure(figsize=(width, height), layout="constrained")


def png(figure: Any) -> bytes:
    """Return the figure as a PNG file, without date and version: the same figure gives the same bytes."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def pdf(figure: Any) -> bytes:
    """Return the figure as a page of PDF, without its date: the same figure gives the same bytes."""
    buffer = BytesIO()
    figure.savefig(buffer, format="pdf", metadata={"CreationDate": None, "Producer": None, "Creator": None})
    return buffer.getvalue()
