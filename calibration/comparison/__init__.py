"""What changed between two campaigns of one machine: one machine and a sparse change, fitted to both together."""

__all__ = [
    "candidates",
    "compare",
    "result",
    "same_machine",
    "search",
    "two_campaigns",
    "two_folders",
    "workspace",
]
