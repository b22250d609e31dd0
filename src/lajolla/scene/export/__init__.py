"""Export of a scene to Mitsuba 3."""
