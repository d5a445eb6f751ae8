"""The steps. A step that was released is never changed; what it does is in terms of its own time."""

__all__ = ["v0001_baseline", "v0002_chain", "v0003_life"]
