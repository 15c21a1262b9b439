"""A printer that obeys ASA carriage control."""


def played(text):
    """Return the pages that an ASA printer makes of a text."""
    pages = []
    for line in text.splitlines():
        if line[0] == "1":
            pages.append([])
        pages[-1] += [""] * {"1": 0, " ": 0, "0": 1, "-": 2}[line[0]] + [line[1:]]
    return pages
