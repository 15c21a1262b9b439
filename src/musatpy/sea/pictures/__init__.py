"""Pictures, by matplotlib: the extra `plots`, imported where a picture is made."""
