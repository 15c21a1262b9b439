"""Orientation of photos from nothing but images and control: one method, one file."""
