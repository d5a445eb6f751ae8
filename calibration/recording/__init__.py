"""Campaigns and measurement folders as plain files, and the same in memory: checked before anything uses them."""
