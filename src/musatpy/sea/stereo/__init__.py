"""The water surface from simultaneous stereo: estimated from points on it, and used for the points below."""
