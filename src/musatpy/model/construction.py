"""Construction of the frozen arrays that the model is made of: one row per entity, shapes checked, read-only."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray


def freeze(owner: object, name: str, dtype: DTypeLike, *shape: int) -> None:
    """Replace attribute `name` of the frozen dataclass `owner` by a read-only array of `dtype` and `shape`.

    A size of -1 stands for any. Raises `ValueError` naming the class, the attribute and both shapes.
    """
    array: NDArray[Any] = np.asarray(getattr(owner, name), dtype=dtype)
    if array.size == 0 and shape[0] in (0, -1):
        array = array.reshape([max(size, 0) for size in shape])
    fits = array.ndim == len(shape) and all(want in (-1, got) for want, got in zip(shape, array.shape, strict=True))
    if not fits:
        raise ValueError(f"{type(owner).__name__}.{name} has shape {array.shape}, not {shape}")
    if array.flags.writeable:
        array = array.view()
        array.flags.writeable = False
    object.__setattr__(owner, name, array)


def check_links(owner: object, name: str, size: int) -> None:
    """Raise `ValueError` unless every integer link in attribute `name` points at one of `size` rows."""
    links = getattr(owner, name)
    if links.size and not (0 <= links.min() and links.max() < size):
        raise ValueError(f"{type(owner).__name__}.{name} links outside 0..{size - 1}")
