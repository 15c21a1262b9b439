"""The waves of a deck: what linear theory knows of them, what cannot be, and the surface that they make."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from musatpy.arrays import FloatArray
from musatpy.model import Waves, WaveShape
from musatpy.refraction.surface import Surface
from musatpy.refraction.waves import superposed
from musatpy.sea.theory import LinearWave, Shape, linear_wave, period_of, wave_surface

SHAPES: dict[str, Shape] = {"": Shape.SINUSOIDAL} | {shape.value: Shape[shape.name] for shape in WaveShape}
_FASTEST = 3.0  # times the speed of deep water: with any current, the length or the speed of a card is wrong
URSELL = 26.0  # from there on a shallow wave is far from sinusoidal (see `LinearWave.ursell`)


def wave_trains(waves: Waves) -> LinearWave:
    """Return period, depth, number and height of the waves (k,): as given, the rest by linear theory.

    Where the period alone is given, theory has the length, where the length alone, the period; speed is length over
    period. What cannot be found is NaN.
    """
    depth = np.where(np.isnan(waves.depth), np.inf, waves.depth)
    T, L, c = waves.period, waves.length, waves.speed
    L = _first(L, T * c)
    alone = np.isnan(L) & (T > 0.0) & (depth > 0.0)
    number = 2.0 * np.pi / L
    number[alone] = linear_wave(T[alone], depth[alone]).number
    with np.errstate(invalid="ignore"):  # a length that cannot be
        period = _first(T, L / c, period_of(number, depth))
    return LinearWave(period=period, depth=depth, number=number, height=waves.height)


def _first(*values: FloatArray) -> FloatArray:
    """Return the first of several values (k,) that is known."""
    known = values[0]
    for other in values[1:]:
        known = np.where(np.isnan(known), other, known)
    return known


def surface_of(waves: Waves) -> Surface:
    """Return the waves added up, about level 0; axes east, north, up at their origin. Raises `ValueError`."""
    return superposed(*(_surface(waves, row) for row in range(len(waves.ids))))


def require_sinusoidal(waves: Waves) -> None:
    """Raise `ValueError` unless all waves are sinusoidal: beside unknown waves there are no others."""
    for name, shape in zip(waves.ids.tolist(), waves.shape.tolist(), strict=True):
        if SHAPES[shape] is not Shape.SINUSOIDAL:
            raise ValueError(f"where waves are unknown all of them are sinusoidal; {name} is of shape {shape}")


def depths_of_theory(waves: Waves) -> FloatArray:
    """Return the depths (k,) m from which the speeds of waves follow as their lengths change.

    Infinite for deep water, NaN where they do not follow: the period, or the speed, that a card gives stays.
    """
    alone = np.isnan(waves.period) & np.isnan(waves.speed)
    return np.where(alone, np.where(np.isnan(waves.depth), np.inf, waves.depth), np.nan)


def _surface(waves: Waves, row: int) -> Surface:
    train = wave_trains(waves)
    return wave_surface(
        SHAPES[str(waves.shape[row])],
        amplitude=float(waves.height[row]) / 2.0,
        length=float(train.length[row]),
        azimuth=float(np.pi / 2.0 - waves.azimuth[row]),  # from east towards north
        speed=float(train.speed[row]),
        crest=float(waves.crest[row]),
        depth=float(train.depth[row]),
    )


def faults(waves: Waves) -> Iterator[tuple[int, str, str, bool]]:
    """Yield row, attribute, message and whether it is an error, of a wave that cannot be, or is out of theory."""
    for row in range(len(waves.ids)):
        wrong = list(_of_statement(waves, row))
        yield from wrong
        if not wrong and np.isfinite([waves.height[row], waves.azimuth[row], waves.crest[row]]).all():
            yield from _of_theory(waves, row)


def _of_statement(waves: Waves, row: int) -> Iterator[tuple[int, str, str, bool]]:
    """Yield what is wrong with what a card says, whatever the wave."""
    for name in ("period", "depth", "length", "speed"):
        if getattr(waves, name)[row] <= 0.0:
            yield row, name, "must be greater than zero", True
    if waves.height[row] < 0.0:
        yield row, "height", "a height from trough to crest is not negative", True
    given = [name for name in ("period", "length", "speed") if np.isfinite(getattr(waves, name)[row])]
    if len(given) == 3:
        message = "period, length and speed are given: two of them say the third"
        yield row, "speed", message, True
    elif not {"period", "length"} & set(given):
        yield row, "period", "blank, and no length: one of them is needed", True


def _of_theory(waves: Waves, row: int) -> Iterator[tuple[int, str, str, bool]]:
    train = wave_trains(waves)
    height, length, depth, most = (
        float(values[row]) for values in (train.height, train.length, train.depth, train.breaking_height)
    )
    shape = SHAPES.get(str(waves.shape[row]))
    if shape is Shape.TROCHOIDAL and depth < length / 2.0:
        message = (
            f"a trochoidal wave is one of deep water: {depth:g} m is less than half its length of {length:.1f} m"
        )
        yield row, "depth", message, True
    if train.breaks[row]:
        yield row, "height", f"{height:g} m: a wave {length:.1f} m long breaks from {most:.2f} m on", True
        return
    calm = length / float(period_of(train.number[row], np.inf))
    if train.speed[row] > _FASTEST * calm:
        name = "period" if np.isnan(waves.speed[row]) else "speed"
        slower = f"a wave {length:.3g} m long runs {calm:.3g} m/s at most, without a current"
        yield row, name, f"{train.speed[row]:.3g} m/s: {slower}", True
        return
    if shape is None:
        return  # said of the field already
    try:
        _surface(waves, row)
    except ValueError as error:
        yield row, "height", str(error), True
        return
    if shape is Shape.SINUSOIDAL and train.ursell[row] > URSELL:
        message = f"a wave of {height:g} m, {length:.1f} m long, in {depth:g} m of water is far from sinusoidal"
        yield row, "height", f"{message}: its Ursell number is {train.ursell[row]:.0f}", False
