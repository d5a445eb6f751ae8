"""The record of all campaigns of a folder: an append-only database with a schema version and a hash chain."""

__all__ = [
    "append",
    "audit",
    "campaign_state",
    "chain",
    "connections",
    "copies",
    "former_life",
    "life",
    "life_facts",
    "lock",
    "migrate",
    "migrations",
    "removal",
    "schema",
    "sessions",
    "store",
    "stored_machine",
    "stored_rows",
]
