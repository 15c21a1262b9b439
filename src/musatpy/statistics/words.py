"""The words in which a deck, or an answer, is stated: what reports ask of a statement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from musatpy.model import Block, CoordinateSystem, SystemSpec
from musatpy.units import AngleUnit

if TYPE_CHECKING:
    from musatpy.systems import Statement

_ANGLES = {
    "OPK": ("Omega", "Phi", "Kappa"),
    "POK": ("Phi", "Omega", "Kappa"),
    "ATS": ("Azimuth", "Tilt", "Swing"),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Words:
    """A statement, with what a SYS card says of it."""

    spec: SystemSpec
    statement: Statement

    @property
    def angular(self) -> bool:
        """True where the first two coordinates are angles (rad)."""
        return self.spec.kind == CoordinateSystem.GEOGRAPHIC

    @property
    def unit(self) -> AngleUnit:
        """In which angles are printed."""
        return self.spec.unit

    @property
    def names(self) -> tuple[str, str, str]:
        """The names of the coordinates."""
        return self.statement.system.names

    @property
    def units(self) -> tuple[str, str, str]:
        """The units of the coordinates."""
        return self.statement.system.units

    @property
    def angles(self) -> tuple[str, str, str] | None:
        """The names of the angles of an attitude; None where attitudes are matrices."""
        return _ANGLES.get(self.spec.angles)

    @property
    def of_system(self) -> bool:
        """True where sigmas are of the stated coordinates and attitudes; else of east, north, up and X-tilt, ..."""
        return self.spec.sigmas == "SYST"

    @property
    def has_plane(self) -> bool:
        """True where error ellipses are in the plane of the first two coordinates, not across the vertical."""
        return self.of_system and self.statement.system.plane


def words_of(spec: SystemSpec | None, block: Block) -> Words | None:
    """Return the words of a statement of a block, None of none. Raises `SystemsError` where it is no statement."""
    if spec is None:
        return None
    from musatpy.systems import statement_of

    return Words(spec=spec, statement=statement_of(spec, block))
