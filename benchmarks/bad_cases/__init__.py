"""Campaigns in which somebody has made a mistake: none may end with tables that are worse than none."""
