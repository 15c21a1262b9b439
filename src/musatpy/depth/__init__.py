"""Depth factors: over a stereo model as tables and pictures, and applied to files of apparent points."""
