"""Soundings beside a compiled bottom: what differs, why, and by which standard."""
