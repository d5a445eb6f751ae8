"""From stored readings to poses of the platform: drift, report frame, pose filter, and figures of measured error."""
