"""The adjustments: unknowns, normals, iteration, and the MUSAT programs themselves."""

from musatpy.adjustment.musat2a import adjust

__all__ = ["adjust"]
