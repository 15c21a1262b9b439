"""Cards for a deck out of what people have: tables, words typed without columns, readings of a tide gauge."""
