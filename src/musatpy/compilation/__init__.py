"""Stereomodels set up from a triangulation, and what is compiled in them through the water (AS-11)."""
