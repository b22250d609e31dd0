"""Old files with the names and defaults of Mitsuba 3."""
