"""What an orientation through the water is asked for: the ORI card (Okamoto and Mori 1974)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from musatpy.model.options import Weights


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


class StripPlane(StrEnum):
    """Whether the triplets of a strip see one plane of water."""

    COMMON = "COMMON"
    FREE = "FREE"


@dataclass(frozen=True, kw_only=True)
class OrientationSpec:
    """The method, its weights (FULL or EQUAL), what of the water is unknown, and the photos.

    The photos are named, all or none: without names they are those of the deck that have images, as in a strip,
    whose triplets see one plane of water or each its own (`join`). `limit` is the sigma of the level of the water
    over the mean depth, up to which its plane counts as determined.
    """

    method: OrientationMethod = OrientationMethod.SINGLE_RAY
    weights: Weights = Weights.FULL
    plane: PlaneTreatment = PlaneTreatment.ADJUST
    join: StripPlane = StripPlane.COMMON
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
