"""The grid of a compensation table: how fine it is and how far it reaches beyond the workspace."""

POINTS = (9, 17, 33, 64)  # along an axis, tried in turn; the last is the most that a drive takes
POINTS_PER_AXIS = 17  # where the noise is not known
MOST_ADDED = 0.05  # of the noise of a measured position, by interpolation between the nodes (both RMS)
CHECKED = 512  # poses at which that is looked at
GRID_MARGIN_M = 0.02
BEYOND_WORKSPACE_M = 0.07
