"""One rig: its file, its devices behind one set of verbs, its supervision, its clock, its record."""
