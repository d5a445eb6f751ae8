"""The record of all campaigns of a folder: an append-only database with a schema version and a hash chain."""

__all__ = ["chain", "connections", "migrate", "migrations", "schema", "sessions", "store"]
