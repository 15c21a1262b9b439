"""Least-squares collocation: errors of heights between control points, from a trend, a signal and noise."""
