"""The adjustments: unknowns, normals, iteration, and the MUSAT programs themselves."""
