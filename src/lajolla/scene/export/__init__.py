"""The way out: a scene in the words of Mitsuba 3."""
