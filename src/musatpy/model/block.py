"""The block: everything that a deck says, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass, field

from musatpy.model.arrays import check_links
from musatpy.model.cameras import Cameras, Distortion, Fiducials
from musatpy.model.control import (
    AirBases,
    Control,
    Distances,
    EqualElevations,
    HeightDifferences,
    no_distances,
    no_height_differences,
)
from musatpy.model.observations import FiducialMeasurements, PlateMeasurements
from musatpy.model.options import EllipsoidSpec, Options
from musatpy.model.photos import Photos
from musatpy.model.points import Points
from musatpy.model.reduction import (
    ComparatorSpec,
    CrossMeasurements,
    Lenses,
    MarkDistances,
    Plates,
    ReductionOptions,
    ReseauCrosses,
    no_cross_measurements,
    no_lenses,
    no_mark_distances,
    no_reseau_crosses,
)
from musatpy.model.systems import SystemSpec
from musatpy.model.water import Water
from musatpy.model.waves import WaveOrigin, Waves, no_waves


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """One job. Raises `ValueError` where a link points outside its table."""

    titles: tuple[str, ...]
    options: Options
    ellipsoid: EllipsoidSpec | None  # None in local jobs
    water: Water | None  # None: no water card
    cameras: Cameras
    distortion: Distortion
    fiducials: Fiducials
    photos: Photos
    fiducial_measurements: FiducialMeasurements
    points: Points
    plates: PlateMeasurements
    control: Control
    equal_elevations: EqualElevations
    air_bases: AirBases
    distances: Distances = field(default_factory=no_distances)
    height_differences: HeightDifferences = field(default_factory=no_height_differences)
    reduction: ReductionOptions | None = None  # None: no card, the plate coordinates are refined
    comparator: ComparatorSpec | None = None
    lenses: Lenses = field(default_factory=no_lenses)
    mark_distances: MarkDistances = field(default_factory=no_mark_distances)
    reseau: ReseauCrosses = field(default_factory=no_reseau_crosses)
    cross_measurements: CrossMeasurements = field(default_factory=no_cross_measurements)
    waves: Waves = field(default_factory=no_waves)
    wave_origin: WaveOrigin | None = None  # None: no card
    given_in: SystemSpec | None = None  # how the deck states all this; None: as it stands here
    stated_in: SystemSpec | None = None  # how the answer is stated; None: as the deck is

    @property
    def answer_in(self) -> SystemSpec | None:
        """How the answer is stated; None: in the system of the options."""
        return self.stated_in or self.given_in

    def __post_init__(self) -> None:
        cameras, photos, points = len(self.cameras.ids), len(self.photos.ids), len(self.points.ids)
        for table in (
            self.distortion,
            self.fiducials,
            self.photos,
            self.lenses,
            self.mark_distances,
            self.reseau,
        ):
            check_links(table, "camera", cameras)
        for photo_table in (self.plates, self.fiducial_measurements, self.air_bases, self.cross_measurements):
            check_links(photo_table, "photo", photos)
        for point_table in (
            self.plates,
            self.control,
            self.equal_elevations,
            self.distances,
            self.height_differences,
        ):
            check_links(point_table, "point", points)
        check_links(self.equal_elevations, "group", len(self.equal_elevations.ids))

    @property
    def raw(self) -> bool:
        """True where the plate coordinates are comparator readings, which have to be reduced."""
        return self.reduction is not None and self.reduction.plates is Plates.RAW
