"""Rotations, geodesy and the conditions between images, stations and ground."""
