"""`lajolla view`: a scene in the browser, rendered while it is looked at; see docs/viewer.md."""
