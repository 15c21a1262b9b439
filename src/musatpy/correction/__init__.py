"""Apparent points of files corrected for refraction: the photographs that see them, and what comes of the file."""
