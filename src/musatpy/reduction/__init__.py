"""Plate reduction: from comparator readings to refined plate coordinates. One module per step."""
