"""The one machine behind all mock devices: its true geometry, elasticity, temperatures and sight lines."""

__all__ = [
    "affected_machine",
    "atmosphere",
    "elastic_batch",
    "motion_history",
    "optics",
    "plant",
    "structure",
    "thermal",
    "true_machine",
    "truth",
]
