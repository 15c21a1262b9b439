"""What an adjustment found of waves whose parameters were unknown."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from musatpy.arrays import BoolArray, FloatArray, TextArray
from musatpy.model.tables import Table, per_row
from musatpy.units import DEGREE

PARAMETERS = ("height", "length", "azimuth", "crest")
CORRELATED = 0.95  # as where correlations are listed: so much of a parameter is another's
_SEEN = 5.0  # sigmas of a height that is no noise: of many waves, one always fits it by three or four
OPEN = 0.5  # of a length: a guess that leaves crests more open than that may lead to wrong ones
_SURE = 0.5  # of the sigma before: a parameter whose sigma is at most that much of it is determined


def _in_words(wave: FloatArray) -> str:
    """Return height, length, azimuth and crest (4,) as a deck states them."""
    height, length, azimuth, crest = wave.tolist()
    return (
        f"height {height:.2f} m, length {length:.2f} m, towards {azimuth / DEGREE:.2f} degrees, crest {crest:.2f} m"
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class AdjustedWaves(Table):
    """k waves after the adjustment, (k, 4): height (m), length (m), azimuth (rad), crest (m), as on their cards.

    Heights are from trough to crest, azimuths clockwise from true north (+Y of local jobs), crests distances from
    the origin of the waves at time 0. Sigmas and variance inflation are NaN for what was known.
    """

    ids: TextArray = per_row()  # (k,)
    value: FloatArray = per_row(4)
    prior: FloatArray = per_row(4)  # what was given
    prior_sigma: FloatArray = per_row(4)
    sigma: FloatArray = per_row(4)  # a posteriori
    kept: FloatArray = per_row(4)  # a priori sigma over that of the prior: 1 where nothing was learnt
    inflation: FloatArray = per_row(4)  # variance inflation factors
    speed: FloatArray = per_row()  # (k,) m/s of the crests
    open: FloatArray = per_row()  # (k,) of a length: sigma, as given, of crests at the typical distance of points
    rival: FloatArray = per_row(4)  # of other crests that fit nearly as well, NaN where none were met
    excess: FloatArray = per_row()  # (k,) by which the sum of squares is higher with these
    searched: BoolArray = per_row()  # (k,) the search went over all that the sigmas allow
    first: TextArray = per_row(rows="pairs")  # (c,) names of unknown parameters,
    second: TextArray = per_row(rows="pairs")  # (c,) of these, of the other water, and of one station height each,
    correlation: FloatArray = per_row(rows="pairs")  # (c,) and how they are correlated

    @property
    def period(self) -> FloatArray:
        """(k,) s, length over speed; infinite for waves that stand still."""
        with np.errstate(divide="ignore"):
            return self.value[:, PARAMETERS.index("length")] / self.speed

    @property
    def unsure(self) -> BoolArray:
        """(k,) True where other crests fit nearly as well, or may lie where they were not looked for."""
        return np.isfinite(self.excess) | ((self.open > OPEN) & ~self.searched)

    @property
    def warnings(self) -> tuple[str, ...]:
        """A sentence for every wave of which too little was given, and every parameter that was not determined."""
        vague = tuple(
            f"what is given of wave {self.ids[wave]} leaves its crests open by {self.open[wave]:.1f} of a length "
            f"(1 sigma) at the typical distance of the points from the origin of the waves, too much to search: "
            f"the crests may be others; an origin, and a time 0, in the middle of the points leave less open"
            for wave in np.flatnonzero((self.open > OPEN) & ~self.searched).tolist()
        )
        rivals = tuple(
            f"other crests of wave {self.ids[wave]} fit nearly as well: {_in_words(self.rival[wave])} raise the "
            f"weighted sum of squares by {self.excess[wave]:.1f} only"
            for wave in np.flatnonzero(np.isfinite(self.excess)).tolist()
        )
        lost = tuple(
            f"the {PARAMETERS[parameter]} of wave {self.ids[wave]} is {self.verdicts[wave, parameter]}"
            for wave, parameter in np.argwhere(np.char.startswith(self.verdicts, "not")).tolist()
        )
        return vague + rivals + lost

    @cached_property
    def verdicts(self) -> TextArray:
        """(k, 4) whether each parameter was determined, and if not, why; empty for what was known."""
        tied = self.inflation >= 1.0 / (1.0 - CORRELATED**2)
        verdict = np.where(self.kept <= _SURE, "determined", "weakly determined")
        verdict = np.where(self.kept >= CORRELATED, "not determined: does not show", verdict)
        verdict = np.where((self.kept >= CORRELATED) & tied, "not determined: not apart from others", verdict)
        with np.errstate(invalid="ignore"):
            faint = np.abs(self.value[:, :1]) < _SEEN * self.sigma[:, :1]
        faint = faint & (np.arange(4) > 0) & (self.kept < CORRELATED)
        verdict = np.where(faint, "not determined: lost in the noise", verdict)
        return np.asarray(np.where(np.isnan(self.kept), "", verdict), dtype=np.str_)
