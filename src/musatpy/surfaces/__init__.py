"""Surfaces over points in a plane, and their contours: of heights or depths, whatever they are of."""
