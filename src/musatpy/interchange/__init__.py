"""Points, lines and grids in the formats of geographic information systems, CAD and chart production."""
