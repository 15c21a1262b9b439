"""The adjustments: unknowns, normals, iteration, and the MUSAT programs themselves."""

from musatpy.adjustment.job import adjust

__all__ = ["adjust"]
