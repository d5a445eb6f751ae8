"""Pure computation: from a machine description and readings to parameters and tables."""
