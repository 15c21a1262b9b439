"""A run for geographic information systems: stations, footprints, points, control and observations as layers."""
