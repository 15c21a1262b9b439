"""The adjustments: unknowns, normals, iteration, and the MUSAT programs themselves."""

from musatpy.adjustment.programs import adjust

__all__ = ["adjust"]
