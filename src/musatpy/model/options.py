"""What kind of job it is: the option card, the ellipsoid, how it is stated, what is recorded of it; the ORI card.

That asks for an orientation through the water (Okamoto and Mori 1974).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from musatpy.units import ARC_SECOND, AngleUnit


class CoordinateSystem(StrEnum):
    """The system in which a deck gives stations and control."""

    GEOGRAPHIC = "GEOG"  # latitude, longitude (rad), ellipsoidal height (m)
    GEOCENTRIC = "GEOC"  # X, Y, Z (m)
    LOCAL = "LOCL"  # right-handed rectangular X, Y, Z (m), the vertical +Z everywhere


class Refraction(StrEnum):
    """How submerged points are treated (docs/theory.md, The modes)."""

    NONE = "NONE"  # as if there were no water
    LEGACY = "LEGACY"  # WATPT as printed in 1983
    WATPT = "WATPT"  # its differential form, iterated with the adjustment
    RIGOROUS = "RIGOROUS"  # refracted rays in the conditions themselves


class Weights(StrEnum):
    """Weights of the coplanarity and scale restraint conditions."""

    FULL = "FULL"  # (A Q A^T)^-1 per point: the simultaneous bundle
    DIAGONAL = "DIAGONAL"  # the diagonal of A Q A^T only
    EQUAL = "EQUAL"  # one weight for each kind of condition


class Program(StrEnum):
    """Which of the MUSAT programs runs."""

    IIA = "IIA"  # coplanarity and scale restraint, one photo after the other
    IIIA = "IIIA"  # collinearity of all points at once, refraction in the equations


class Initial(StrEnum):
    """Where the initial values of the exposure stations come from."""

    GIVEN = "GIVEN"  # the station and attitude cards
    COMPUTE = "COMPUTE"  # the plate coordinates and the control
    CHECK = "CHECK"  # the cards, compared with what COMPUTE finds


class WaterLevel(StrEnum):
    """Which photos share an unknown correction of their tides (IIIA)."""

    KNOWN = "KNOWN"  # the tides are what the cards say
    ONE = "ONE"  # all photos
    PHOTO = "PHOTO"  # each photo has its own
    GROUP = "GROUP"  # photos whose tide cards name the same group
    DAY = "DAY"  # photos whose tide cards name the same day


class Treatment(StrEnum):
    """Whether something of the water is known, or an unknown of the adjustment (IIIA)."""

    KNOWN = "KNOWN"
    ADJUST = "ADJUST"


class Datum(StrEnum):
    """What holds the block as a whole."""

    CONTROL = "CONTROL"  # control, observed stations, known water
    FREE = "FREE"  # inner constraints hold what nothing else does (IIIA)


class Editing(StrEnum):
    """What is done about blunders."""

    NONE = "NONE"  # nobody looks for them
    LIST = "LIST"  # they are found and listed, and stay in
    EDIT = "EDIT"  # they are found, listed and taken out


class CauseSearch(StrEnum):
    """How far a run that is not accepted looks for its causes, by the counted work of its adjustment."""

    NONE = "none"
    USUAL = "usual"  # twice
    ALL = "all"  # eight times


class Order(StrEnum):
    """Order of the rows of stations, points, control and residuals."""

    CARDS = "CARDS"  # that of the deck
    IDS = "IDS"  # by the identifiers of photos and points


class PlateSigma(StrEnum):
    """What the plate sigmas of a deck are worth."""

    KNOWN = "KNOWN"  # sigma0 is tested against 1
    GUESS = "GUESS"  # they are estimated, by their variance component: sigma0 says nothing


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of a job. Angles in radians, lengths in metres, plate sigma in millimetres."""

    program: Program = Program.IIA
    system: CoordinateSystem = CoordinateSystem.GEOGRAPHIC
    refraction: Refraction = Refraction.WATPT
    weights: Weights = Weights.FULL
    max_iterations: int = 20  # of one triangulation
    max_passes: int = 20  # of WATPT around the triangulation
    rotation_limit: float = 0.1 * ARC_SECOND
    translation_limit: float = 0.001
    water_limit: float = 0.001  # movement of submerged points from pass to pass
    plate_sigma: float = 0.010  # of plate coordinates whose card gives none
    initial: Initial = Initial.GIVEN
    submerged_factor: float = 1.0  # by which the plate sigmas of submerged points are multiplied
    water_level: WaterLevel = WaterLevel.KNOWN
    water_tilt: Treatment = Treatment.KNOWN
    water_index: Treatment = Treatment.KNOWN
    datum: Datum = Datum.CONTROL
    editing: Editing = Editing.NONE
    order: Order = Order.CARDS
    plate_sigma_is: PlateSigma = PlateSigma.KNOWN
    sigma0_limit: float = 3.0  # from which a run is rejected
    station_limit: float = 0.2  # flying heights between adjusted and given stations, from which a run is doubtful


@dataclass(frozen=True, kw_only=True)
class EllipsoidSpec:
    """An ellipsoid by PROJ name (`clrk66`, `WGS84`, ...), or by semi-major axis (m) and inverse flattening.

    Exactly one of the two ways is used: `name` is empty where `semi_major_axis` is given.
    """

    name: str = ""
    semi_major_axis: float | None = None
    inverse_flattening: float | None = None

    def __post_init__(self) -> None:
        if bool(self.name) == (self.semi_major_axis is not None):
            raise ValueError("an ellipsoid has either a name or a semi-major axis and an inverse flattening")


class RecordContent(StrEnum):
    """What of a job its JSON record has."""

    FULL = "full"
    TABLES = "tables"  # all but the tables of images
    NONE = "none"


@dataclass(frozen=True, kw_only=True)
class SystemSpec:
    """A statement in plain values, in the words of docs/systems.md. What a kind does not use must be empty."""

    kind: str = "GEOG"
    definition: str = ""  # of a projected system: code, PROJ string or WKT
    geoid: str = ""  # grid file of a projected system with heights above a geoid
    origin: tuple[float, float, float] | None = None  # of a tangent plane: latitude, longitude (rad), height (m)
    false: tuple[float, float, float] | None = None  # m, its coordinates; 0 where not given
    axes: str = "VERT"
    angles: str = "OPK"  # or MATR
    sigmas: str = "LOCL"
    unit: AngleUnit = AngleUnit.DMS  # of angles on cards and in listings; inside they are radians


class OrientationMethod(StrEnum):
    """The methods of orientation from nothing."""

    SINGLE_RAY = "SINGLE-RAY"  # one photo by control: refracted rays
    SINGLE_FERMAT = "SINGLE-FERMAT"  # the same by Fermat's principle
    PAIR_INDEPENDENT = "PAIR-INDEPENDENT"  # two photos in the axes of their base
    PAIR_SUCCESSIVE = "PAIR-SUCCESSIVE"  # two photos in the axes of the first
    COMBINED = "COMBINED"  # two photos by control and by the rays that meet
    TRIPLET = "TRIPLET"  # three photos in the axes of the first base
    STRIP = "STRIP"  # triplets joined, on the ground with control

    @property
    def photos(self) -> int:
        """The number of photos that it takes, a strip at least."""
        return {"SINGLE": 1, "TRIPLET": 3, "STRIP": 4}.get(self.value.partition("-")[0], 2)

    def in_model(self, control: bool) -> bool:
        """Return whether its result stands in axes of its own, as there is no control or it takes none."""
        return self.value.startswith(("PAIR", "TRIPLET")) or (self is OrientationMethod.STRIP and not control)


class PlaneTreatment(StrEnum):
    """What of the plane of water is unknown."""

    ADJUST = "ADJUST"  # its tilt and level
    LEVEL = "LEVEL"  # its level
    KNOWN = "KNOWN"  # nothing


@dataclass(frozen=True, kw_only=True)
class OrientationSpec:
    """The method, its weights (FULL or EQUAL), what of the water is unknown, and the photos.

    The photos are named, all or none: without names they are those of the deck that have images, as in a strip.
    `limit` is the sigma of the level of the water over the mean depth, up to which its plane counts as determined.
    """

    method: OrientationMethod = OrientationMethod.SINGLE_RAY
    weights: Weights = Weights.FULL
    plane: PlaneTreatment = PlaneTreatment.ADJUST
    first: str = ""
    second: str = ""
    third: str = ""
    limit: float = 0.1

    @property
    def photos(self) -> tuple[str, ...]:
        """The photos that are named."""
        return tuple(name for name in (self.first, self.second, self.third) if name)

    def faults(
        self, measured: Sequence[str], with_tide: Collection[str], index: float, control: bool
    ) -> Iterator[tuple[str, str]]:
        """Yield what cannot be with the photos that have images, and tides: the attribute that says it, and why.

        `control`: there are points of it.
        """
        for field in ("first", "second", "third"):
            if (name := getattr(self, field)) and name not in measured:
                yield field, f"photo {name} has no images"
        photos, need = self.photos or tuple(measured), self.method.photos
        if self.method is OrientationMethod.STRIP:
            yield from self._strip_faults(measured)
        elif len(set(photos)) != need or len(photos) != need:
            some = ", ".join(photos[:8]) + (", ..." if len(photos) > 8 else "")
            where = "named here" if self.photos else "of the deck: name those to be oriented"
            yield "method", f"{self.method} takes {need} different photos, not {len(photos)} ({some}), {where}"
        if self.method.in_model(control) and self.plane is not PlaneTreatment.ADJUST:
            yield (
                "plane",
                f"no plane of water is known in the axes of a model, without control: ADJUST it, not {self.plane}",
            )
        photos = tuple(name for name in photos if name in measured)
        lacking = [name for name in photos if name not in with_tide]
        if lacking and (self.plane is PlaneTreatment.KNOWN or len(lacking) < len(photos)):
            why = "the plane is KNOWN" if self.plane is PlaneTreatment.KNOWN else "others have one"
            yield "plane", f"{why}, and there is no tide of {', '.join(lacking)}"
        if index == 1.0 and self.plane is not PlaneTreatment.KNOWN:
            yield (
                "plane",
                "with an index of 1 the images say nothing of the water: its plane must be KNOWN",
            )

    def _strip_faults(self, measured: Sequence[str]) -> Iterator[tuple[str, str]]:
        if self.photos:
            yield "first", "STRIP takes all photos that have images, in the order of their overlaps: name none"
        if len(measured) < self.method.photos:
            yield (
                "method",
                f"STRIP takes {self.method.photos} photos at least, not {len(measured)}: TRIPLET takes 3",
            )
