"""The grid of a compensation table: how fine it is and how far it reaches beyond the workspace."""

POINTS_PER_AXIS = 17
GRID_MARGIN_M = 0.02
BEYOND_WORKSPACE_M = 0.07
