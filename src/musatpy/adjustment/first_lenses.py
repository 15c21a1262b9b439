"""First values of lenses that are free: focal length and radial distortion, and errors of images, by pairs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from musatpy.adjustment.lenses import CameraLenses, ideal_plates
from musatpy.adjustment.ports import without_ports
from musatpy.model import LENS_PARAMETERS, Block, Initial
from musatpy.orientation.relative import relative_orientations
from musatpy.orientation.strips import FEWEST, common_images, common_tangents, sights_of, tangent_sigma

_STEP = 1.05  # from one focal length to the next
_BEND = 0.03  # from one radial distortion to the next, as a share of the radius at 45 degrees
_MOST = 14  # steps
_BETTER = 0.9  # of the error: with less, pairs do not tell one lens from another
_PAIRS = 50  # that are enough
_AROUND = (1, 0), (-1, 0), (0, 1), (0, -1)  # steps of focal length and distortion
_F, _K1 = LENS_PARAMETERS.index("F"), LENS_PARAMETERS.index("K1")
_MISFIT = "rays of pairs meet better with another focal length or radial distortion: the adjustment starts from"


def with_first_lenses(block: Block) -> tuple[Block, Block, tuple[str, ...]]:
    """Return the block with first values of its lenses, the same for the search of stations, and notes.

    Free focal lengths are changed by one factor, and with them free K1, to where rays of pairs meet best, if that
    is better by a tenth. In the search images are ideal, and as good as these rays meet.
    """
    seen, table = ideal_plates(block), block.lens_unknowns
    focal, radial = (np.flatnonzero((table.parameter == name) & np.isnan(table.sigma)) for name in ("F", "K1"))
    radial = radial[np.isin(table.camera[radial], table.camera[focal])]
    sights, sigma = sights_of(without_ports(seen)), tangent_sigma(seen)
    *pairs, ends, images = common_images(sights, FEWEST)
    if not (focal.size and len(ends) and block.options.initial is Initial.COMPUTE):
        return block, seen, ()
    sample = slice(None, None, max(1, len(ends) // _PAIRS))
    *tangents, weight, _ = common_tangents(sights, ends[sample], images)
    changing = [np.isin(block.photos.camera[photo[sample]], table.camera[focal])[:, None, None] for photo in pairs]

    def error(step: tuple[int, int]) -> float:
        """Return the median distance of the rays of a pair, as a tangent by the given focal lengths."""
        factor = _STEP ** step[0]
        far = [x / factor for x in tangents]
        bent = [x * (1.0 + _BEND * step[1] * np.square(x).sum(axis=-1, keepdims=True)) for x in far]
        x1, x2 = (np.where(*ends) for ends in zip(changing, bent, tangents, strict=True))
        models = relative_orientations(x1, x2, weight, sigma / factor)
        return factor * float(np.median(models.scale[models.is_sound])) if models.is_sound.any() else np.inf

    errors = {(0, 0): error((0, 0))}
    best, better = (0, 0), True
    while better:
        better = False
        for a, b in _AROUND[: 4 if radial.size else 2]:
            while (at := (best[0] + a, best[1] + b)) not in errors and max(map(abs, at)) <= _MOST:
                errors[at] = error(at)
                if errors[at] < errors[best]:
                    best, better = at, True
    if not errors[best] < _BETTER * errors[0, 0]:
        best = (0, 0)
    lenses, value = CameraLenses.of(block), table.value.copy()
    length, bend = lenses.held[table.camera, _F] * _STEP ** best[0], lenses.sign * _BEND * best[1]
    value[focal] = length[focal]
    value[radial] = lenses.held[table.camera[radial], _K1] - bend / np.square(length[radial])
    notes: tuple[str, ...] = ()
    if best != (0, 0):
        block = replace(block, lens_unknowns=replace(table, value=value))
        seen = ideal_plates(block)
        first = ", ".join(
            f"{value[row]:.4g} mm of camera {lenses.ids[table.camera[row]]}" for row in focal.tolist()
        )
        notes = (f"{_MISFIT} {first}",)
    plate_sigma = max(seen.options.plate_sigma, errors[best] * float(np.median(lenses.held[:, _F])))
    if np.isfinite(plate_sigma):
        seen = replace(seen, options=replace(seen.options, plate_sigma=plate_sigma))
    return block, seen, notes
