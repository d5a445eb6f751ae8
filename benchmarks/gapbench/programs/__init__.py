"""Programs that are entered from the start; each reads a recording folder and prints one JSON object."""
