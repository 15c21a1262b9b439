"""The standard reports of printed listings: read, held against themselves, and beside a newer run.

Legacy listings, scanned ones included, and our own are read alike: by titles, labels and what a cell must be.
"""

from musatpy.listings.audit.against import SideBySide, side_by_side
from musatpy.listings.audit.reading import Listing, audit, listing_of, read_listing
