"""Sea waves: linear theory, and what mapping through them as if the water were level costs (Okamoto 1982)."""
