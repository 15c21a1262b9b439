"""`musat list`: what is in a deck."""

command = None
