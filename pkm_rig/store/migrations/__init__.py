"""Alembic's folder: how a store of each former schema becomes one of the next."""

__all__ = ["env", "triggers", "versions"]
