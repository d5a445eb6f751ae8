"""What the checks of the diagnosis have in common: measures, the goals that they are held to, and the printed table."""
