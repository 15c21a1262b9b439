"""Printed reports -> structures, their consistency, and what they say beside another run.

Legacy listings, scanned ones included, and our own are read alike: by titles, labels and what a cell must be.
"""
