"""Columns that several listings share: positions in the job's system, attitudes, sigmas, names."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from musatpy.arrays import FloatArray, IntArray
from musatpy.model import Block, CoordinateSystem
from musatpy.reports.table import Column
from musatpy.statistics import Statistics, metric_components
from musatpy.units import ARC_SECOND

Columns = tuple[Column[Statistics], ...]


def vector(
    headings: Sequence[str],
    edits: Sequence[str],
    values: Callable[[Statistics], FloatArray],
    *,
    unit: float = 1.0,
) -> Columns:
    """Return one column per component of `values` (n, k), each divided by `unit`."""

    def component(axis: int) -> Callable[[Statistics], FloatArray]:
        return lambda source: values(source)[:, axis] / unit

    return tuple(
        Column(heading, edit, component(axis))
        for axis, (heading, edit) in enumerate(zip(headings, edits, strict=True))
    )


def position_columns(block: Block, values: Callable[[Statistics], FloatArray], decimals: int) -> Columns:
    """Return the columns of positions (n, 3) in the job's system, metres with `decimals`."""
    if block.options.system is CoordinateSystem.GEOGRAPHIC:
        headings = ("Latitude\nD  M  S    ", "Longitude\nD  M  S    ", "Elevation\nm")
        return vector(headings, ("S16.5", "S16.5", f"F11.{decimals}"), values)
    return vector(("X\nm", "Y\nm", "Z\nm"), (f"F15.{decimals}",) * 3, values)


def attitude_columns(values: Callable[[Statistics], FloatArray], decimals: int) -> Columns:
    """Return the columns of attitudes (n, 3) rad, in degrees, minutes and seconds."""
    headings = ("X-Tilt\nD  M  S   ", "Y-Tilt\nD  M  S   ", "Heading\nD  M  S   ")
    return vector(headings, (f"S{11 + decimals}.{decimals}",) * 3, values)


def metric_columns(block: Block, values: Callable[[Statistics], FloatArray], *, sigma: bool) -> Columns:
    """Return the columns of differences or sigmas (n, 3) along east, north, up (X, Y, Z in local jobs), metres."""
    label = "Sigma " if sigma else ""
    return vector([f"{label}{name}\nm" for name in metric_components(block)], ("F9.3",) * 3, values)


def attitude_sigma_columns(values: Callable[[Statistics], FloatArray]) -> Columns:
    """Return the columns of attitude sigmas (n, 3) rad, in arc seconds."""
    headings = ("Sigma X-T\narc sec", "Sigma Y-T\narc sec", "Sigma Hdg\narc sec")
    return vector(headings, ("F9.2",) * 3, values, unit=ARC_SECOND)


def photo_column(links: Callable[[Statistics], IntArray]) -> Column[Statistics]:
    """Return the column of photo ids at the given rows of the photos."""
    return Column("Photo", "A8", lambda source: source.block.photos.ids[links(source)])


def point_column(links: Callable[[Statistics], IntArray]) -> Column[Statistics]:
    """Return the column of point ids at the given rows of the points."""
    return Column("Point", "A8", lambda source: source.block.points.ids[links(source)])


def camera_column(links: Callable[[Statistics], IntArray]) -> Column[Statistics]:
    """Return the column of camera ids at the given rows of the cameras."""
    return Column("Camera", "A6", lambda source: source.block.cameras.ids[links(source)])
